"""Truncated Newton: the direction that solves H d = -g as far as it pays."""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from ..state import State
from .block_matrix import BlockMatrix
from .confirmation import ACCURACY, SLOWEST, Confirmation, Step
from .conjugate_gradient import ConjugateGradient, LinearSolution
from .multilevel import Multilevel
from .products import Products

ON_THE_WAY = 0.03
"""The part of the tolerance that a solve may leave on the way: where tissue is expected next goes by it."""
POSITIVE_ACCURACY = 0.3
"""The part of the distance that a solve along the curvature made positive may leave: such a step leaves more where
tissue is crushed, so that solves to a tenth took as many steps, and a third more iterations; where volume is a
thousand times as stiff as usual they took a fifth of the iterations."""
CONTRACTION = 0.2
"""A step that leaves more than this part of the distance calls for the curvature of where it led."""
FIRST = 2.0 / 3.0
"""What the first step of a relaxation is taken to leave of the distance: its curvature, made positive, is too
stiff where edges are compressed, and nothing has been seen of how steps shrink."""
NEAR = 20.0
"""So many tolerances from the equilibrium the true curvature takes over, where a claim is wanted."""
CLOSE = 10.0
"""A step of so many tolerances along the true curvature may have led to within one of them."""
TRUE_ACCURACY = 0.03
"""The part of the distance that a solve along the true curvature may leave, so that one from there will do."""
REACH = 10.0
"""A way down from a saddle is first tried as far as this many tolerances."""


class Newton:
    """The default method; it knows how far the equilibrium is.

    Its direction is the vector to the equilibrium, as far as the linear solve and the curvature go, so
    the length of its longest arrow is the distance [mm]. The curvature is that of an earlier step as long
    as the steps shrink fast. Once the line search had to cut a step, solves no longer end early: stiff
    motions then hide soft ones, and a short solve of what a step along the soft ones left would look converged.

    Far away the curvature is made positive, so that every direction descends; it is stiffer than the truth, and
    its steps are shorter than the way to go. Where the end is to be confirmed, the true one takes over near it. If
    that is negative along some direction, the way goes down there (Steihaug 1983).
    """

    memory = 1
    """Energies the line search looks back on: the last one, so the energy falls at every step."""
    distance: float
    """How far the equilibrium is estimated to be [mm]; infinite where a direction leads down from a saddle."""
    floor: float
    """What rounding leaves of every distance [mm]; to be set before the first direction is asked for."""
    as_started: bool
    """Whether the direction last proposed is the end of a solve that `start` began."""

    def __init__(self, state: State, like: Newton | None = None) -> None:
        """For a state at rest: the preconditioner is made of the curvature there, or shared with another's."""
        self._state = state
        if like is None:
            self._matrix = BlockMatrix(state)
            self._preconditioner = Multilevel(self._matrix, self._matrix.assemble)
        else:
            self._matrix = BlockMatrix(state, like._matrix.sparsity)
            self._preconditioner = like._preconditioner.of(self._matrix)
        graph = state.model.parallel.graph
        self._assemble_positive, self._assemble_true = (
            graph(self._matrix.assemble),
            graph(self._matrix.assemble_true),
        )
        self._solver = ConjugateGradient(self._matrix, self._preconditioner, state.gradient)
        self._confirmation = Confirmation(state, self._matrix, self._preconditioner)
        self.begin(math.inf, 0.0)

    @property
    def direction(self) -> wp.array:
        """d [mm], shape (free,), vec3."""
        return self._solver.solution

    @property
    def slope_ratio(self) -> float | None:
        """The line search takes the first decrease of a Newton step; down from a saddle it looks farther."""
        return 0.5 if math.isinf(self.distance) else None

    def begin(self, tolerance: float, floor: float = 0.0, *, confirm: bool = False, near: bool = False) -> None:
        """Begins a relaxation to a tolerance, where rounding leaves `floor` of every distance [mm].

        With `confirm` its end is to be confirmed; `near`, it begins some tolerances from there.
        """
        self._tolerance, self.floor = tolerance, floor
        self._confirm, self._starts_near = confirm, near
        self._longest_solve = 0
        self._cut = self._true = False
        self._length = self._shrink = math.inf
        self._norm = 0.0
        self._down: np.ndarray | None = None
        self._started = False
        self.distance = math.inf
        self._confirmation.begin()

    def true_curvature(self) -> tuple[BlockMatrix, Multilevel]:
        """The matrix, set to the true curvature at the state, and the preconditioner."""
        self._assemble_positive()
        self._assemble_true()
        return self._matrix, self._preconditioner

    @property
    def has_another(self) -> bool:
        """Whether the next direction at the same state is another: down from a saddle, or the first true one."""
        return self._down is not None or (not self._true and self._is_near)

    @property
    def _is_near(self) -> bool:
        return self._confirm and (self._starts_near or self.distance <= NEAR * self._tolerance)

    def _assemble(self) -> None:
        """Sets the matrix to the curvature at the state; the preconditioner needs a positive one before all."""
        if not self._true or self._starts_near:
            self._assemble_positive()
        if self._true:
            self._assemble_true()

    def start(self, products: Products | None, last_length: float) -> bool:
        """Begins to solve for the direction at the state, what `propose` with the same arguments then waits for.

        Returns whether there is a solve, whose end will most likely be the direction.
        """
        if self._down is not None:
            return False
        whole = products is not None and last_length == 1.0
        self._cut = self._cut or (products is not None and last_length < 1.0 and self.distance < math.inf)
        was_true = self._true
        self._true = self._is_near
        if self._true != was_true or not self._shrink <= CONTRACTION:
            self._assemble()
        self._starts_near = False
        accuracy = TRUE_ACCURACY if self._true else POSITIVE_ACCURACY
        least = self._longest_solve if self._cut else 0
        absolute = (ACCURACY if self._confirm else ON_THE_WAY) * self._tolerance
        self._solver.start(absolute, accuracy, least)
        self._started, self._goes_on = True, whole and was_true and self._true
        return True

    def propose(self, products: Products | None, last_length: float) -> tuple[float, int]:
        """Sets the direction at the state; returns the length to try first and the linear iterations spent."""
        self.as_started = self._started
        if self._down is not None:
            self._go_down(np.zeros_like(self._down), self._down)
            return 1.0, 0
        if not self._started:
            self.start(products, last_length)
        self._started = False
        solution = self._solver.ended()
        self._longest_solve = max(self._longest_solve, solution.iterations)
        if self._true and solution.bent:
            self._go_down(self._solver.solution.numpy(), self._solver.search.numpy())
            self.as_started = False
            return 1.0, solution.iterations
        if self._true and math.isinf(solution.longest):  # of a preconditioner made too far away
            self.distance = math.inf
            return 1.0, solution.iterations + self.propose(None, 1.0)[1]  # as nothing has been started
        last = self._last_step(solution.norm)
        self._measure(solution)
        if self._goes_on:
            self._confirmation.saw(Step(last.length, max(last.left, self._length)))
        return 1.0, solution.iterations

    def _measure(self, solution: LinearSolution) -> None:
        """Sets the distance by the length of a direction and how much shorter it is than the one before."""
        length = solution.longest + solution.left
        self._shrink = length / self._length if 0.0 < self._length < math.inf else math.inf
        steady = min(self._shrink, SLOWEST) if self._length < math.inf else FIRST
        self._length, self._norm = length, solution.norm
        self.distance = self.floor + length * max(1.0, steady / (1.0 - steady))

    def _last_step(self, norm: float) -> Step:
        """The last whole step by the gradient that it left, in the preconditioner's norm."""
        return Step(self._length, norm / self._norm * self._length if self._norm > 0.0 else 0.0)

    def _go_down(self, start: np.ndarray, down: np.ndarray) -> None:
        """Sets the direction to a start and on down a direction of negative curvature."""
        gradient = self._state.gradient.numpy()[: len(down)].astype(float)
        sign = -1.0 if np.vdot(gradient, down) > 0.0 else 1.0
        reach = max(REACH * self._tolerance, longest(start)) / max(longest(down), 1e-300)
        self._solver.solution.assign((start + sign * reach * down).astype(down.dtype))
        self._length = self._shrink = self.distance = math.inf
        self._confirmation.begin()
        self._down = None

    def arrives(self, length: float, products: Products) -> tuple[bool, int]:
        """Whether the relaxation can end, and the linear iterations spent on that; sets `distance`.

        It can where the estimate is below the tolerance, or if that is to be confirmed, where the equilibrium is
        known to be so near.

        Args:
            length: the part of the direction that has led here from where it was found.
            products: those at the state.
        """
        if not self._confirm:
            return self.distance <= self._tolerance, 0
        if not self._true or self.floor + self._length > CLOSE * self._tolerance:
            return False, 0
        if length:
            self._assemble_true()
            self._shrink = 0.0  # the curvature of here
        norm = self._solver.norm() if length else self._norm
        last = self._last_step(norm) if length == 1.0 else None
        if last is not None and last.length > self._tolerance and last.left > TRUE_ACCURACY * self._tolerance:
            return False, 0  # one more step costs less than to judge what this one left
        verdict = self._confirmation.judge(self._tolerance, self.floor, products.gradient_squared, norm, last)
        self.distance = verdict.distance
        if verdict.down is not None:
            self._down = verdict.down.numpy()
        return verdict.distance <= self._tolerance, verdict.iterations


def longest(vectors: np.ndarray) -> float:
    """Length of the longest vector."""
    return float(np.linalg.norm(vectors.astype(float), axis=1).max(initial=0.0))
