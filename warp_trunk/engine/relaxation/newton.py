"""Truncated Newton: the direction that solves H d = -g as far as it pays."""

from __future__ import annotations

import math

import warp as wp

from ..state import State
from .block_matrix import BlockMatrix
from .conjugate_gradient import ConjugateGradient
from .multilevel import Multilevel
from .products import Products

ACCURACY = 0.1
"""A linear solve may leave this part of the distance to equilibrium, or of the tolerance."""
CONTRACTION = 0.2
"""A step that leaves more than this part of the distance calls for the curvature of where it led."""
FIRST = 2.0 / 3.0
"""What the first step of a relaxation is taken to leave of the distance: its curvature, made positive, is too
stiff where edges are compressed, and nothing has been seen of how steps shrink."""
SLOWEST = 0.95
"""Steps are taken to shrink at least this fast from one to the next."""


class Newton:
    """The default method; it knows how far the equilibrium is.

    Its direction is the vector to the equilibrium, as far as the linear solve and the curvature go, so
    the length of its longest arrow is the distance [mm]. The curvature is that of an earlier step as long
    as the steps shrink fast. Once the line search had to cut a step, solves no longer end early: stiff
    motions then hide soft ones, and a short solve of what a step along the soft ones left would look converged.
    """

    memory = 1
    """Energies the line search looks back on: the last one, so the energy falls at every step."""
    slope_ratio: float | None = None
    """The line search takes the first decrease; a Newton step needs no finer length."""

    def __init__(self, state: State) -> None:
        """For a state at rest: the preconditioner is made of the curvature there."""
        self._matrix = BlockMatrix(state)
        self._matrix.assemble()
        self._solver = ConjugateGradient(self._matrix, Multilevel(self._matrix), state.gradient)
        self.begin(math.inf, 0.0)

    @property
    def direction(self) -> wp.array:
        """d [mm], shape (free,), vec3."""
        return self._solver.solution

    def begin(self, tolerance: float, floor: float) -> None:
        """Begins a relaxation to a tolerance, where rounding leaves `floor` of every distance [mm]."""
        self._tolerance, self.floor = tolerance, floor
        self._longest_solve = 0
        self._cut = False
        self._length = self._shrink = math.inf
        self.distance = math.inf

    def propose(self, products: Products | None, last_length: float) -> tuple[float, int]:
        """Sets the direction at the state; returns the length to try first and the linear iterations spent."""
        self._cut = self._cut or (products is not None and last_length < 1.0)
        if not self._shrink <= CONTRACTION:
            self._matrix.assemble()
        solution = self._solver.solve(
            ACCURACY * self._tolerance, ACCURACY, self._longest_solve if self._cut else 0
        )
        self._longest_solve = max(self._longest_solve, solution.iterations)
        length = solution.longest + solution.left
        self._shrink = length / self._length if 0.0 < self._length < math.inf else math.inf
        steady = min(self._shrink, SLOWEST) if self._length < math.inf else FIRST
        self._length = length
        self.distance = self.floor + length * max(1.0, steady / (1.0 - steady))
        return 1.0, solution.iterations
