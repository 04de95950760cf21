"""Volume term, eq. 4.10 and 4.14 of [2]: the square of a tetrahedron's relative change of volume."""

from typing import Any

import warp as wp

from .geometry import relative_volume_change


@wp.func
def volume_gradients(a: Any, b: Any, c: Any):
    """Gradient of the signed volume in a, b and c."""
    sixth = type(a[0])(1.0) / type(a[0])(6.0)  # Warp would divide literals in single precision
    return sixth * wp.cross(b, c), sixth * wp.cross(c, a), sixth * wp.cross(a, b)


@wp.func
def volume_term(a0: Any, b0: Any, c0: Any, da: Any, db: Any, dc: Any, rest_volume: Any, weight: Any):
    """Energy w ((V - V0) / V0)^2, and its gradient in a, b and c."""
    growth = relative_volume_change(a0, b0, c0, da, db, dc, rest_volume)
    ga, gb, gc = volume_gradients(a0 + da, b0 + db, c0 + dc)
    force = weight * (growth + growth) / rest_volume
    return weight * growth * growth, force * ga, force * gb, force * gc
