"""Gravity term, eq. 4.7, 4.11 and 4.15 of [2], with the sign of physics: lower is lower energy."""

from typing import Any

import warp as wp


@wp.func
def gravity_term(u0: Any, u1: Any, u2: Any, u3: Any, weight: Any):
    """Potential of a tetrahedron's four quarter masses, weight * (sum of heights), from the rest position.

    The weight is alpha m_i / (M_0 H_0), the force on each corner along +z.
    """
    return weight * (u0[2] + u1[2] + u2[2] + u3[2])
