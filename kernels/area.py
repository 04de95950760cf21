"""Area term, eq. 4.9 and 4.13 of [2]: the square of a face's relative change of area."""

from typing import Any

import warp as wp

from .geometry import cross_change, direction_of, relative_norm_change


@wp.func
def area_term(a0: Any, b0: Any, da: Any, db: Any, rest_area: Any, weight: Any):
    """Energy w ((A - A0) / A0)^2 of the face spanned by a and b, and its gradient in a and in b."""
    half = type(rest_area)(0.5)
    normal0 = wp.cross(a0, b0)
    change = cross_change(a0, b0, da, db)
    growth = relative_norm_change(normal0, change, rest_area + rest_area)
    normal = direction_of(normal0 + change)
    force = weight * (growth + growth) * half / rest_area
    return weight * growth * growth, force * wp.cross(b0 + db, normal), force * wp.cross(normal, a0 + da)


@wp.func
def area_curvature(a0: Any, b0: Any, da: Any, db: Any, rest_area: Any, weight: Any, positive: bool):
    """Second derivatives (aa, ab, bb) of the area term; where asked for, made positive semidefinite.

    The square of the gradient (Gauss-Newton), and the change of area times the area's own second derivative:
    a part along the normal, which has the sign of the change, and one in the plane, which is indefinite
    (in ab alone, -1/2 skew(normal)). `positive` keeps of these two the first, for a face that has grown.
    """
    half = type(rest_area)(0.5)
    a = a0 + da
    b = b0 + db
    normal = direction_of(wp.cross(a, b))
    ga = half * wp.cross(b, normal)
    gb = half * wp.cross(normal, a)
    stiffness = (weight + weight) / (rest_area * rest_area)
    area = half * wp.length(wp.cross(a, b))
    zero = type(area)(0.0)
    least = rest_area
    in_plane = zero
    if not positive:
        least = zero
        in_plane = half * (area - rest_area)
    tension = wp.where(area > least, (area - rest_area) / (type(area)(4.0) * area), zero)
    out = wp.outer(normal, normal)
    return (
        stiffness * (wp.outer(ga, ga) + (tension * wp.dot(b, b)) * out),
        stiffness * (wp.outer(ga, gb) - (tension * wp.dot(a, b)) * out - in_plane * wp.skew(normal)),
        stiffness * (wp.outer(gb, gb) + (tension * wp.dot(a, a)) * out),
    )
