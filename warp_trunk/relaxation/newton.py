"""Truncated Newton: the direction that solves H d = -g as far as it pays."""

from __future__ import annotations

import warp as wp

from ..energy import State
from .linear import LinearSystem
from .products import Products

REDUCTION = 0.1
"""Relative residual of the linear solve: a step then leaves about this part of the distance."""


class Newton:
    """The default method. The length of its direction is at the same time the estimate of the distance left."""

    memory = 1
    """Energies the line search looks back on: the last one, so the energy falls at every step."""
    slope_ratio: float | None = None
    """The line search takes the first decrease; a Newton step needs no finer length."""
    estimates_every = 1
    """Its direction is the estimate."""

    def __init__(self, linear: LinearSystem) -> None:
        self.linear = linear

    @property
    def direction(self) -> wp.array:
        """d [mm], shape (free,), vec3."""
        return self.linear.solution

    def propose(self, state: State, products: Products | None, last_length: float) -> tuple[float, int]:
        """Sets the direction at the state; returns the length to try first and the linear iterations spent."""
        self.linear.assemble(state)
        return 1.0, self.linear.solve(state, REDUCTION).iterations
