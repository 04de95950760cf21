"""What conjugate gradients carry from one iteration to the next."""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from .dots import Dots


@dataclass(frozen=True)
class Iterates:
    """Vectors of the free nodes, shape (free nodes,), vec3, and their products."""

    solution: wp.array
    """d [mm]."""
    residual: wp.array
    """r = -g - H d."""
    preconditioned: wp.array
    """z = M^-1 r."""
    search: wp.array
    """p, the direction searched."""
    product: wp.array
    """q = H p."""
    r_dot_z: Dots
    """r . z."""
    p_dot_q: Dots
    """p . q."""
