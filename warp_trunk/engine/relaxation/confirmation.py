"""What a relaxation may claim at its end: solves for what is left of the gradient, by the true curvature."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import warp as wp

from warp_trunk.kernels.loop import loop_kernels

from ..state import State
from .block_matrix import BlockMatrix
from .conjugate_gradient import ConjugateGradient, LinearSolution
from .curvature_change import CurvatureChange
from .preconditioner import Preconditioner
from .rounding import Rounding

ACCURACY = 0.1
"""The part of the tolerance that a solve may leave."""
OPEN = 2.0
"""So many tolerances are left at the least where a solve for every direction came to no end."""
LEAST_NOISE = 1e-12
"""Noise on a gradient of zero: it finds a saddle all the same, and is no distance."""
ROUNDED = 4.0
"""A gradient of at most so many samples of its rounding holds nothing else."""
FALLEN = 0.01
"""A solve for a gradient with other roundings ends when its residual has fallen to this part."""
UNSEEN = 0.9
"""What a step is taken to leave of a distance longer than the tolerance where none was seen."""
SLOWEST = 0.95
"""Steps are taken to shrink at least this fast from one to the next."""


@dataclass(frozen=True)
class Verdict:
    """What is known of a state."""

    distance: float
    """How far the equilibrium can be [mm]; infinite where there is none."""
    down: wp.array | None
    """A direction of negative curvature where one was found, shape (free nodes,), vec3."""
    iterations: int
    """Iterations of the linear solver spent on it."""


@dataclass(frozen=True)
class Step:
    """A whole step along the true curvature."""

    length: float
    """Of its longest vector [mm]."""
    left: float
    """What it left of that: by the solve after it, or by how much less the gradient fell [mm]."""


class Confirmation:
    """H e = -(g + n): e is how far the equilibrium can be, with noise n on the gradient.

    What is left of a gradient at the end can hold next to nothing of some directions: the steps before have solved
    for them, or no force points off a ridge. White noise as large as the gradient holds something of each. A
    residual that falls below its part of one direction, while no negative curvature is met, says that there is
    none, and an e within the tolerance leaves nothing open. A longer one may be due to the noise, which moves soft
    tissue more than rounding does; if rounding is all that is left, n is a sample of it, see `Rounding`. Where the
    solve has to be given up, soft directions hide behind others 1e9 times as stiff: then nothing is claimed.
    """

    def __init__(self, state: State, matrix: BlockMatrix, preconditioner: Preconditioner) -> None:
        """For the gradient of a state and the matrix as they are at the time."""
        self._state, self._matrix, self._preconditioner = state, matrix, preconditioner
        model = state.model
        self._directions = max(3 * model.free_nodes, 1)
        noise = np.random.default_rng(0).standard_normal((model.free_nodes, 3))
        self._noisy = noisy = model.free_vectors()
        self._amount = model.zeros(wp.float64, 1)
        self._add_noise = model.over_free(
            loop_kernels(*model.variant).step,
            [self._amount, state.gradient, model.array(noise, model.vec3)],
            [noisy],
        )
        self._with_noise = ConjugateGradient(matrix, preconditioner, noisy)
        self.begin()

    def begin(self) -> None:
        """Forgets the steps so far."""
        self._steps: list[Step] = []

    def saw(self, step: Step) -> None:
        """Takes note of a whole step along the true curvature."""
        self._steps.append(step)

    def judge(
        self, tolerance: float, floor: float, gradient_squared: float, norm: float, last: Step | None
    ) -> Verdict:
        """What is known of the state.

        Args:
            tolerance: what the distance is wanted to be below [mm].
            floor: what rounding leaves of every displacement [mm].
            gradient_squared: g . g.
            norm: the square root of g . M^-1 g.
            last: the whole step that led here, its `left` not known yet; None where none did.
        """
        self._amount.fill_(max(math.sqrt(gradient_squared / self._directions), LEAST_NOISE))
        self._add_noise()
        solution = self._with_noise.solve(ACCURACY * tolerance, 1.0 / math.sqrt(self._directions))
        if solution.bent:
            return Verdict(math.inf, self._with_noise.search, solution.iterations)
        spent, probed = solution.iterations, (tolerance, solution.longest)
        least = tolerance * (OPEN if solution.exhausted else ACCURACY)
        if floor + self._reach(solution, last, *probed) > tolerance:
            rounded = self._solve_rounded(tolerance, norm)
            if rounded is not None:
                solution, spent = rounded, spent + rounded.iterations
        return Verdict(max(floor + self._reach(solution, last, *probed), least), None, spent)

    def _reach(self, solution: LinearSolution, last: Step | None, tolerance: float, longest: float) -> float:
        """How far the equilibrium can be where a solve says so far [mm].

        The last step at least as long, which left a part q, says how little the curvature changes on the way:
        there is one equilibrium within 1 / (1 - q) of the length (Newton and Kantorovich). Where there was none,
        as from a start nearer than rounding can tell, a step as long as the tolerance is tried along the solution
        of the first solve, of that length.
        """
        left = solution.longest + solution.left
        steps = self._steps
        if last is not None:
            left = max(left, last.left)
            steps = [*steps, Step(last.length, left)]
        seen = (step.left / step.length for step in reversed(steps) if step.length >= left > 0.0)
        shrink = next(seen, None)
        if shrink is None:
            resolved = left <= tolerance and 0.0 < longest < math.inf
            shrink = self._change.left(tolerance / longest) if resolved else UNSEEN
        return left / (1.0 - min(shrink, SLOWEST))

    def _solve_rounded(self, tolerance: float, norm: float) -> LinearSolution | None:
        """Solves for the gradient with other roundings; None where it is not rounding that is left."""
        rounding = self._rounding
        rounding.evaluate()
        if norm > ROUNDED * rounding.norm():
            return None
        return rounding.solve(ACCURACY * tolerance, FALLEN)

    @cached_property
    def _change(self) -> CurvatureChange:
        return CurvatureChange(self._state, self._preconditioner, self._with_noise, self._noisy)

    @cached_property
    def _rounding(self) -> Rounding:
        return Rounding(self._state, self._matrix, self._preconditioner)
