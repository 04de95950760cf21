"""Preconditioned conjugate gradients for the Newton system H d = -g."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warp_trunk.kernels.conjugate_gradient import (
    BENT,
    ITERATIONS,
    LEFT,
    LONG,
    NORM,
    RUN,
    conjugate_gradient_kernels,
)

from ..host_report import Report
from ..model import Model
from ..parallel import Launch, in_turn, view
from .block_matrix import BlockMatrix
from .device_loop import record_loop
from .dots import PADDING, Dots
from .iterates import Iterates
from .preconditioner import Preconditioner

WINDOW = 8
"""Iterations between two looks at the solution; they shrink its error to about a half."""


@dataclass(frozen=True)
class LinearSolution:
    """How a linear solve ended."""

    iterations: int
    """Products with the matrix."""
    longest: float
    """Length of the solution's longest vector [mm]; not finite where a vector is not."""
    left: float
    """Error that may be left in a vector [mm], from how the changes over WINDOW iterations shrank."""
    bent: bool
    """Whether a search direction of negative curvature was met; the solve ended there and `search` holds it."""
    norm: float
    """The square root of g . M^-1 g."""
    exhausted: bool = False
    """Whether the bound of iterations ended it, and nothing is known of what is left."""


class ConjugateGradient:
    """A solver with its vectors on the device; `solve` writes `solution`."""

    solution: wp.array
    """d [mm], shape (free nodes,), vec3."""
    residual: wp.array
    """-g - H d, shape (free nodes,), vec3."""
    search: wp.array
    """The last search direction, shape (free nodes,), vec3."""

    def __init__(
        self, matrix: BlockMatrix, preconditioner: Preconditioner, gradient: wp.array, most_iterations: int = 500
    ) -> None:
        """Records the launches.

        Args:
            matrix: H; what is assembled at the time of a solve holds.
            preconditioner: M, see there.
            gradient: g, whose free nodes are read at each solve, shape (nodes,), vec3.
            most_iterations: the bound of a solve.
        """
        self.model = model = matrix.model
        ranges, parallel = model.parallel.ranges, model.parallel
        self._most_iterations = most_iterations
        self._iteration, self._go_on = (model.zeros(wp.int32, 1) for _ in range(2))
        rows = most_iterations + WINDOW + 1
        r_dot_z, p_dot_q = (Dots.of(model, self._iteration, rows) for _ in range(2))
        self._limits, self._outcome = model.zeros(wp.float64, 3), model.zeros(wp.float64, 6)
        self._limited: tuple[float, ...] = ()
        self._told, self._told_products = (Report(parallel, array) for array in (self._outcome, r_dot_z.products))
        x, r, z, p, q = (in_whole_runs(model) for _ in range(5))
        self.solution, self.residual, self.search = x, r, p
        iterates = Iterates(x, r, z, p, q, r_dot_z, p_dot_q)
        record_iterations = iterations_on_cuda if parallel.is_cuda else iterations_on_cpu
        self._precondition, self._iterate_window = record_iterations(matrix, preconditioner, iterates)
        kernels = conjugate_gradient_kernels(*model.variant)
        earlier, extent = model.free_vectors(), model.zeros(wp.float64, ranges, PADDING)
        self._start = model.over_free(kernels.start, [gradient], [x, r, p, earlier])
        self._window = model.over_free(kernels.window, [x], [earlier, extent])
        self._decide = parallel.record_undivided(
            kernels.decide,
            1,
            [ranges, most_iterations, self._limits, r_dot_z.products, p_dot_q.products, self._iteration],
            [extent, self._outcome, self._go_on],
        )
        size = math.prod(r_dot_z.products.shape)
        flat = [view(dots.products, wp.float64, size) for dots in (r_dot_z, p_dot_q)]
        self._clear = parallel.record(
            kernels.forget,
            size,
            [],
            [*flat, self._iteration, self._outcome, self._go_on],
            least=size + 1,  # little for one thread
        )
        self._run = record_loop(model, self._begin, self._go_on, self._advance_window, self._told.send)

    def solve(self, absolute: float, relative: float, least: float = 0.0) -> LinearSolution:
        """Solves H d = -g for the gradient as it is now.

        It ends when no vector of d is judged to be wrong by more than `absolute` [mm] or `relative` of the
        longest, and not before `least` iterations: a residual falls long before the long waves of the solution
        have come. It also ends at a search direction of negative curvature, where the matrix has no least energy
        (Steihaug 1983).
        """
        self.start(absolute, relative, least)
        return self.ended()

    def start(self, absolute: float, relative: float, least: float = 0.0) -> None:
        """Begins what `solve` does; `ended` waits for it."""
        limits = (absolute, relative, least)
        if limits != self._limited:
            self._limits.assign(np.array(limits))
            self._limited = limits
        self._run()

    def ended(self) -> LinearSolution:
        """How the solve that was started last ended."""
        outcome = self._told.read()
        return LinearSolution(
            iterations=int(outcome[ITERATIONS]),
            longest=float(outcome[LONG]),
            left=float(outcome[LEFT]),
            bent=bool(outcome[BENT]),
            norm=float(outcome[NORM]),
            exhausted=outcome[ITERATIONS] >= self._most_iterations,
        )

    def norm(self) -> float:
        """The square root of g . M^-1 g for the gradient as it is now; `solution` is zero after it."""
        self._begin()
        self._told_products.send()
        return max(0.0, float(self._told_products.read()[0].sum())) ** 0.5

    def _begin(self) -> None:
        """d = 0, r = -g, z = M^-1 r."""
        self._clear()
        self._start()
        self._precondition()

    def _advance_window(self) -> None:
        """WINDOW iterations and a look at how far they moved the solution."""
        self._iterate_window()
        self._window()
        self._decide()


def iterations_on_cuda(matrix: BlockMatrix, preconditioner: Preconditioner, at: Iterates) -> tuple[Launch, Launch]:
    """Records z = M^-1 r, and WINDOW iterations, in the fewest launches."""
    turn_and_multiply = matrix.turn_and_multiply(at)
    precondition, advance = preconditioner.apply_with_steps(at)
    return precondition, in_turn(*[turn_and_multiply, advance] * WINDOW)


def iterations_on_cpu(matrix: BlockMatrix, preconditioner: Preconditioner, at: Iterates) -> tuple[Launch, Launch]:
    """Records z = M^-1 r, and WINDOW iterations: p = z + beta p, q = H p, d += step p, r -= step q, z = M^-1 r."""
    model = matrix.model
    kernels, ranges = conjugate_gradient_kernels(*model.variant), model.parallel.ranges
    iteration, within = at.r_dot_z.iteration, model.zeros(wp.int32, 1)
    scalars = [ranges, iteration, at.r_dot_z.products, at.p_dot_q.products]
    x, r, z, p, q = (
        runs(model, vectors) for vectors in (at.solution, at.residual, at.preconditioned, at.search, at.product)
    )
    precondition = preconditioner.apply(at.residual, at.preconditioned, at.r_dot_z)
    iterate = in_turn(
        over_runs(model, kernels.turn, [*scalars, z], [p]),
        matrix.multiply(at.search, at.product, at.p_dot_q),
        over_runs(model, kernels.advance, [*scalars, p, q], [x, r]),
        model.parallel.record_undivided(kernels.count, 1, [WINDOW], [iteration, within]),
        precondition,
    )

    def iterate_window() -> None:
        """A loop in the loop: the host takes as long to capture an iteration as to do one."""
        iterate()
        wp.capture_while(within, iterate)

    return precondition, iterate_window


def in_whole_runs(model: Model) -> wp.array:
    """Zero vectors of the free nodes, shape (free nodes,), vec3, with room behind them for a whole last run."""
    return model.zeros(model.vec3, -(-count_runs(model) * RUN // 3))[: model.free_nodes]


def runs(model: Model, vectors: wp.array) -> wp.array:
    """The memory of `in_whole_runs` in runs, as vector registers hold them."""
    return view(vectors, wp.types.vector(RUN, model.scalar), count_runs(model))


def count_runs(model: Model) -> int:
    """How many runs hold the vectors of the free nodes."""
    return -(-3 * model.free_nodes // RUN)


def over_runs(model: Model, kernel: Any, inputs: Sequence[Any], outputs: Sequence[Any]) -> Launch:
    """Records a launch over the runs of the free nodes."""
    return model.parallel.record(
        kernel, count_runs(model), inputs, outputs, least=model.parallel.least_split * 3 // RUN
    )
