"""What conjugate gradients ask of a preconditioner."""

from __future__ import annotations

from typing import Protocol

import warp as wp

from ..parallel import Launch
from .dots import Dots


class Preconditioner(Protocol):
    """A symmetric positive definite M that is near the matrix and whose inverse is cheap to apply."""

    def apply(self, r: wp.array, z: wp.array, r_dot_z: Dots) -> Launch:
        """Records z = M^-1 r with r . z, for vectors of the free nodes, shape (free nodes,), vec3."""
        ...
