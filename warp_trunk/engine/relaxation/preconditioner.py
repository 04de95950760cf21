"""What conjugate gradients ask of a preconditioner."""

from __future__ import annotations

from typing import Protocol

import warp as wp

from ..parallel import Launch
from .dots import Dots
from .iterates import Iterates


class Preconditioner(Protocol):
    """A symmetric positive definite M that is near the matrix and whose inverse is cheap to apply."""

    def apply(self, r: wp.array, z: wp.array, r_dot_z: Dots) -> Launch:
        """Records z = M^-1 r with r . z, for vectors of the free nodes, shape (free nodes,), vec3."""
        ...

    def apply_with_steps(self, at: Iterates) -> tuple[Launch, Launch]:
        """Records, on CUDA, where fewer launches are faster, `apply` and the same after a step.

        The second is for the iterations: x += step p, r -= step q and z = M^-1 r with r . z, and the iteration is
        counted. It must follow the first.
        """
        ...
