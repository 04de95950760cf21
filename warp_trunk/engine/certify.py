"""The final claim of a relaxation: how far the equilibrium can be, by solves with the true Hessian.

H e = -(g + n): e is how far the equilibrium can be, with noise n on the gradient. The gradient at the end can hold
next to nothing of some directions: the steps before have solved for them, or no force points off a ridge. White
noise as large as the gradient holds something of each. A residual that falls below its part of one direction,
while no negative curvature is met, proves that there is none, and an e within the tolerance leaves nothing open. A
longer one may be due to the noise, which moves soft tissue more than rounding does; if rounding is all that is
left, n is a sample of it. Where the solve has to be given up, soft directions hide behind others 1e9 times as
stiff: then nothing is claimed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import warp as wp

from warp_trunk.kernels.vectors import vector_kernels

from .linear import BlockMatrix, ConjugateGradient, Dots, LinearSolution, Preconditioner
from .model import Model
from .parallel import Launch, Readback
from .state import State

ACCURACY = 0.1
"""The part of the tolerance that a solve may leave."""
OPEN = 2.0
"""Least distance in tolerances if a solve for every direction did not end."""
LEAST_NOISE = 1e-12
"""Noise on a gradient of zero: it finds a saddle all the same, and is no distance."""
ROUNDED = 4.0
"""A gradient of at most this many samples of its rounding is only rounding."""
FALLEN = 0.01
"""A solve for a gradient with other roundings ends when its residual has fallen to this part."""
UNSEEN = 0.9
"""The part that a step is assumed to leave of a distance longer than the tolerance where none was seen."""
SLOWEST = 0.95
"""Steps are assumed to shrink at least this fast from one to the next."""
MOST_ITERATIONS = 2000
"""Of a solve for the noise. Crushed tissue of a double major curve took 592."""
GROWS = 2.0
"""Assumed ratio of the final length of a solution to its length where the solve was given up."""
ROUNDINGS = 2.0
"""Largest change of a number by a sample of rounding, in roundings."""


@dataclass(frozen=True)
class Verdict:
    """The certified distance of a state."""

    distance: float
    """How far the equilibrium can be [mm]; infinite where there is none."""
    down: wp.array | None
    """A direction of negative curvature where one was found, shape (free nodes,), vec3."""
    iterations: int
    """Iterations of the linear solver spent on it."""
    exhausted: bool = False
    """Whether the solve was given up, so that another at the same state would be in vain."""


@dataclass(frozen=True)
class Step:
    """A whole step along the true Hessian."""

    length: float
    """Of its longest vector [mm]."""
    left: float
    """The remaining part of that: by the solve after it, or by how much less the gradient fell [mm]."""


class Certificate:
    """Judges the gradient of a state with the matrix as they are at the time."""

    def __init__(self, state: State, matrix: BlockMatrix, preconditioner: Preconditioner) -> None:
        """Draws the noise, the same for every judgement, and records its solver."""
        self._state, self._matrix, self._preconditioner = state, matrix, preconditioner
        model = state.model
        self._directions = max(3 * model.free_nodes, 1)
        noise = np.random.default_rng(0).standard_normal((model.free_nodes, 3))
        self._noisy, self._amount = model.free_vectors(), model.zeros(wp.float64, 1)
        self._add_noise = _add(model, self._amount, state.gradient, model.array(noise, model.vec3), self._noisy)
        self._solver = ConjugateGradient(matrix, preconditioner, self._noisy, MOST_ITERATIONS)
        self._length_per_noise = 0.0
        self._change: HessianChange | None = None
        self._rounding: RoundingSample | None = None
        self.begin()

    def begin(self) -> None:
        """Forgets the steps so far."""
        self._steps: list[Step] = []

    def add(self, step: Step) -> None:
        """Adds a whole step along the true Hessian."""
        self._steps.append(step)

    def judge(
        self,
        tolerance: float,
        floor: float,
        gradient_squared: float,
        norm: float,
        last: Step | None,
        *,
        improving: bool,
    ) -> Verdict:
        """The certified distance of the state.

        While steps shrink, noise that would move the solution beyond the tolerance is not solved for to its
        end: one more step makes the gradient, and so the noise, smaller for a fraction of the iterations.

        Args:
            tolerance: what the distance is wanted to be below [mm].
            floor: what rounding leaves of every displacement [mm].
            gradient_squared: g . g.
            norm: the square root of g . M^-1 g.
            last: the whole step that led here, its `left` not known yet; None where none did.
            improving: whether the step that led here made the gradient smaller.
        """
        noise = max(math.sqrt(gradient_squared / self._directions), LEAST_NOISE)
        expected = self._length_per_noise * noise
        if last is not None and last.length >= expected:  # as `_reach` will have it
            expected /= 1.0 - min(max(expected, last.left) / max(last.length, 1e-300), SLOWEST)
        if improving and expected > tolerance:
            return Verdict(floor + expected, None, 0)
        self._amount.fill_(noise)
        self._add_noise()
        most_length = tolerance if improving else math.inf
        relative = 1.0 / math.sqrt(self._directions)
        solution = self._solver.solve(ACCURACY * tolerance, relative, most_length=most_length)
        if solution.negative_curvature:
            return Verdict(math.inf, self._solver.search, solution.iterations)
        if solution.length > most_length:
            self._length_per_noise = GROWS * solution.length / noise
            return Verdict(floor + solution.length, None, solution.iterations)
        if math.isfinite(solution.length):
            self._length_per_noise = solution.length / noise
        spent, probed, exhausted = solution.iterations, (tolerance, solution.length), solution.exhausted
        least = tolerance * (OPEN if exhausted else ACCURACY)
        if floor + self._reach(solution, last, *probed) > tolerance:
            rounded = self._solve_rounded(tolerance, norm)
            if rounded is not None:
                solution, spent = rounded, spent + rounded.iterations
        return Verdict(max(floor + self._reach(solution, last, *probed), least), None, spent, exhausted)

    def _reach(self, solution: LinearSolution, last: Step | None, tolerance: float, length: float) -> float:
        """How far the equilibrium can be where a solve finds it at some distance [mm].

        The last step at least as long, which left a part q, shows how little the Hessian changes on the way: there
        is one equilibrium within 1 / (1 - q) of the length (Newton and Kantorovich). Where there was none, as from
        a start nearer than rounding can resolve, a step as long as the tolerance is tried along the solution of
        the first solve, of that length."""
        left = solution.length + solution.error
        steps = self._steps
        if last is not None:
            left = max(left, last.left)
            steps = [*steps, Step(last.length, left)]
        seen = (step.left / step.length for step in reversed(steps) if step.length >= left > 0.0)
        shrink = next(seen, None)
        if shrink is None:
            resolved = left <= tolerance and 0.0 < length < math.inf
            shrink = self._part_left(tolerance / length) if resolved else UNSEEN
        return left / (1.0 - min(shrink, SLOWEST))

    def _part_left(self, scale: float) -> float:
        """The fraction of itself that a step of this many solutions would leave."""
        if self._change is None:
            self._change = HessianChange(self._state, self._preconditioner, self._solver, self._noisy)
        return self._change.part_left(scale)

    def _solve_rounded(self, tolerance: float, norm: float) -> LinearSolution | None:
        """Solves for the gradient with other roundings; None where it is not rounding that is left."""
        if self._rounding is None:
            self._rounding = RoundingSample(self._state, self._matrix, self._preconditioner)
        self._rounding.evaluate()
        if norm > ROUNDED * self._rounding.norm():
            return None
        return self._rounding.solve(ACCURACY * tolerance, FALLEN)


class RoundingSample:
    """The gradient of the same trunk with other last digits, of its shape at rest and of the displacement.

    It differs from that of a state by forces of the form of rounding: they balance within each tetrahedron, are
    large where tissue is stiff, and vanish where nothing has moved."""

    def __init__(self, state: State, matrix: BlockMatrix, preconditioner: Preconditioner) -> None:
        """For a state and the matrix as they are at the time of a solve."""
        model, elements, skin = state.model, state.model.elements, state.model.skin

        def changed(shape: wp.array) -> wp.array:
            return model.array(self._change(shape.numpy(), model.precision), model.vec3)

        elements = replace(elements, **{elements.shape: changed(getattr(elements, elements.shape))})
        if skin is not None:
            skin = replace(skin, rest_edge=changed(skin.rest_edge))
        self._state, self._sample = state, State(replace(model, elements=elements, skin=skin))
        self._right_side, minus_one = model.free_vectors(), model.array(np.array([-1.0]), wp.float64)
        self._subtract = _add(model, minus_one, self._sample.gradient, state.gradient, self._right_side)
        self._solver = ConjugateGradient(matrix, preconditioner, self._right_side)

    @staticmethod
    def _change(values: np.ndarray, precision: str) -> np.ndarray:
        """The values with other last digits, the same at every call."""
        amount = ROUNDINGS * float(np.finfo(precision).eps)
        return values * (1.0 + amount * np.random.default_rng(0).uniform(-1.0, 1.0, values.shape))

    def evaluate(self) -> None:
        """Evaluates the gradient at the state as it is now."""
        model, displacement = self._state.model, self._state.displacement.numpy()
        displacement[model.free] = self._change(displacement[model.free], model.precision)
        self._sample.displacement.assign(displacement)
        self._sample.evaluate()

    def norm(self) -> float:
        """Of the difference to the gradient at the state, the square root of its product with M^-1 of itself."""
        self._subtract()
        return self._solver.norm()

    def solve(self, absolute: float, relative: float) -> LinearSolution:
        """Solves for it; the arguments as in `ConjugateGradient.solve`."""
        wp.copy(self._right_side, self._sample.gradient, count=len(self._right_side))
        return self._solver.solve(absolute, relative)


class HessianChange:
    """The part that a whole Newton step along a solution e of H e = -b would leave of itself.

    For a step s e that is the difference between the change of the gradient over it, g(u + s e) - g(u), and s H e,
    as a part of s H e in the preconditioner's norm. It is half the relative change of the Hessian along the step,
    and in proportion to its length."""

    def __init__(
        self, state: State, preconditioner: Preconditioner, solver: ConjugateGradient, right_side: wp.array
    ) -> None:
        """For solutions of a solver, of a right side b, shape (free nodes,), vec3, at a state."""
        model = state.model
        self._state, self._there = state, State(model)
        self._scale = model.zeros(wp.float64, 1)
        force, change, z = (model.free_vectors() for _ in range(3))
        one, minus_one = (model.array(np.array([value]), wp.float64) for value in (1.0, -1.0))
        self._go = _add(model, self._scale, state.displacement, solver.solution, self._there.displacement)
        self._find_force = _add(model, one, right_side, solver.residual, force)  # -H e
        self._subtract = _add(model, minus_one, self._there.gradient, state.gradient, change)
        self._add_force = _add(model, self._scale, change, force, change)
        self._dots = Dots.zero(model)
        self._product = Readback(model.parallel, self._dots.products)
        self._measure_force, self._measure_change = (
            preconditioner.apply(vector, z, self._dots) for vector in (force, change)
        )

    def part_left(self, scale: float) -> float:
        """The fraction of itself that a step of this many solutions would leave."""
        wp.copy(self._there.displacement, self._state.displacement)
        self._scale.fill_(scale)
        self._go()
        self._there.evaluate()
        for launch in (self._find_force, self._subtract, self._add_force):
            launch()
        return self._norm(self._measure_change) / max(scale * self._norm(self._measure_force), 1e-300)

    def _norm(self, measure: Launch) -> float:
        """The square root of v . M^-1 v."""
        self._dots.products.zero_()
        measure()
        self._product.send()
        return math.sqrt(max(0.0, float(self._product.read().sum())))


def _add(model: Model, scale: wp.array, first: wp.array, second: wp.array, total: wp.array) -> Launch:
    """Records total = first + scale second over the free nodes."""
    return model.over_free(vector_kernels(*model.variant).step, [scale, first, second], [total])
