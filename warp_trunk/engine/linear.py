"""The Newton system H d = -g: the sparse matrix of 3x3 blocks over the free nodes, and conjugate gradients."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
import warp as wp

from warp_trunk.kernels.arguments import filled
from warp_trunk.kernels.conjugate_gradient import (
    ERROR,
    GRADIENT_NORM,
    ITERATIONS,
    NEGATIVE_CURVATURE,
    PADDING,
    RESIDUAL_NORM,
    SOLUTION_LENGTH,
    Dots,
    conjugate_gradient_kernels,
)
from warp_trunk.kernels.sparse import (
    PLANES,
    PRODUCT_LANES,
    cpu_product_kernel,
    cuda_product_kernels,
    diagonal_inverter,
)
from warp_trunk.kernels.vectors import vector_kernels

from .assembly import assemble_symmetric
from .model import Model
from .outcome import LinearSolution, Outcome
from .parallel import Launch, Readback, in_sequence, nothing, view
from .state import State
from .topology import equal_parts

WINDOW = 4
"""Iterations between two tests of convergence. With 8, the papers' way took 448 iterations instead of 288."""
SHORT_WINDOW = 2
"""The same of a solve with the projected Hessian, which may leave more and takes few."""


def zero_dots(model: Model, rows: int = 1) -> Dots:
    """Room for the products of some iterations, or for one that is not read."""
    products = model.zeros(wp.float64, rows, PADDING * model.parallel.ranges)
    return filled(Dots, iteration=model.zeros(wp.int32, 1), products=products)


@dataclass(frozen=True)
class Iterates:
    """The vectors of conjugate gradients over the free nodes, shape (free nodes,), vec3, and their products."""

    solution: wp.array
    """x [mm]."""
    residual: wp.array
    """r = b - H x."""
    residual_of_four: wp.array
    """On CUDA, r with four numbers a node, shape (free nodes,), vec4: it is gathered 24 times, and 16 bytes are
    read at once."""
    preconditioned: wp.array
    """z = M^-1 r."""
    search: wp.array
    """p, the search direction."""
    product: wp.array
    """q = H p."""
    r_dot_z: Dots
    """r . z."""
    p_dot_q: Dots
    """p . q."""

    @classmethod
    def zero(cls, model: Model, rows: int) -> Iterates:
        """All of them zero, with room for the products of some iterations and none counted."""
        r_dot_z, p_dot_q = (zero_dots(model, rows) for _ in range(2))
        for dots in (r_dot_z, p_dot_q):
            dots.iteration.fill_(-1)
        x, r, z, p, q = (model.free_vectors() for _ in range(5))
        of_four = model.zeros(wp.types.vector(4, model.scalar), model.free_nodes * model.parallel.is_cuda)
        return cls(x, r, of_four, z, p, q, r_dot_z, p_dot_q)


class Preconditioner(Protocol):
    """A symmetric positive definite M that is near the matrix and whose inverse is cheap to apply."""

    def apply(self, at: Iterates) -> Launch:
        """Records z = M^-1 r with r . z."""
        ...


class BlockMatrix:
    """The Hessian over the free nodes at a state: zero when made, the state's after each `assemble`.

    On the CPU, where the product is limited by the reading of the matrix, it has the blocks on and above the
    diagonal; one whose row and column belong to different threads is there twice, so that no thread writes to a
    row of another."""

    row_start: wp.array
    """First block of each row and the end of the last, shape (free nodes + 1,), int32."""
    columns: wp.array
    """Column of each block, shape (blocks,), int32."""
    blocks: wp.array
    """The blocks, and others behind them, shape (more than blocks,), mat33."""
    bounds: np.ndarray
    """The ranges of rows of the threads, with equally many blocks, shape (ranges + 1,)."""
    inverse_diagonal: wp.array
    """The inverse of each row's diagonal block, made positive, shape (free nodes,), mat33."""

    def __init__(self, state: State) -> None:
        """Records the launches for a state, which may change between two assemblies."""
        self.model = model = state.model
        parallel = model.parallel
        ranges = parallel.ranges if model.free_nodes >= parallel.least_split else 1
        self.bounds = equal_parts(model.edges.row_start(model.free_nodes), ranges)
        pattern, assembly = assemble_symmetric(model, self.bounds)
        self.row_start = model.array(pattern.row_start, wp.int32)
        self.columns = model.array(pattern.columns, wp.int32)
        diagonal = model.array(pattern.diagonal, wp.int32)
        self.blocks, add = assembly.blocks, assembly.at(state.displacement)
        split_planes: list[Launch] = []
        if parallel.is_cuda:  # its product reads each of the nine numbers of the blocks in a plane of its own
            split, size = cuda_product_kernels(model.scalar).split_planes, len(pattern.columns)
            self._planes = model.zeros(model.scalar, PLANES, size)
            split_planes = [parallel.record(split, size, [self.blocks], [self._planes])]
        self.inverse_diagonal = model.zeros(self.blocks.dtype, model.free_nodes)
        invert_diagonal = model.over_free(
            diagonal_inverter(model.scalar), [diagonal, self.blocks, model.scalar(1.0)], [self.inverse_diagonal]
        )
        self.assemble_projected: Launch = in_sequence(add("projected_hessian"), *split_planes, invert_diagonal)
        """Sets the matrix to the Hessian at the state as it is now, projected to a positive semidefinite one."""
        self.assemble_true: Launch = in_sequence(add("hessian"), *split_planes)
        """Sets the matrix to the true Hessian, which may be indefinite; `inverse_diagonal` stays positive."""

    def split(self, size: int) -> np.ndarray:
        """Bounds of equal ranges of [0, size) for the threads that share its rows, also of few items.

        They meet after each launch of a program anyway.
        """
        return np.linspace(0, size, len(self.bounds)).astype(np.int64)

    def multiply(self, p: wp.array, q: wp.array, p_dot_q: Dots) -> Launch:
        """Records q = H p with p . q, for vectors of the free nodes, shape (free nodes,), vec3."""
        model = self.model
        if model.parallel.is_cuda:
            unused = model.free_vectors()
            at = Iterates(unused, unused, unused, p, unused, q, zero_dots(model), p_dot_q)
            return self.update_search_and_multiply(at)
        carried = model.zeros(wp.types.vector(4, model.scalar), len(p))
        inputs = [self.row_start, self.columns, self.blocks, p]
        return model.parallel.record(cpu_product_kernel(model.scalar), self.bounds, inputs, [q, p_dot_q, carried])

    def update_search_and_multiply(self, at: Iterates) -> Launch:
        """Records p = z + beta p and q = H p with p . q."""
        model, dots = self.model, [at.r_dot_z, at.p_dot_q]
        if model.parallel.is_cuda:
            z, p, q = (view(v, model.scalar, 3 * len(v)) for v in (at.preconditioned, at.search, at.product))
            inputs = [self.row_start, self.columns, self._planes, *dots, at.preconditioned, z]
            kernel = cuda_product_kernels(model.scalar).update_search_and_multiply
            return model.parallel.record(kernel, PRODUCT_LANES * model.free_nodes, inputs, [p, q])
        update_search = conjugate_gradient_kernels(model.scalar).update_search
        update = model.parallel.record(update_search, self.bounds, [*dots, at.preconditioned], [at.search])
        return in_sequence(update, self.multiply(at.search, at.product, at.p_dot_q))

    def update_solution(self, at: Iterates) -> Launch:
        """Records x += alpha p and r -= alpha q, but before the first iteration; it counts the iteration."""
        model, kernels = self.model, conjugate_gradient_kernels(self.model.scalar)
        dots, vectors = [at.r_dot_z, at.p_dot_q], [at.search, at.product, at.solution, at.residual]
        if model.parallel.is_cuda:
            size = 3 * model.free_nodes
            numbers = [view(each, model.scalar, size) for each in vectors]
            of_four = view(at.residual_of_four, model.scalar, 4 * model.free_nodes)
            return model.parallel.record(kernels.step, size, [*dots, *numbers], [of_four])
        return model.parallel.record(kernels.update_solution, self.bounds, [*dots, *vectors], [])


class ConjugateGradient:
    """A solver with its vectors on the device; `solve` writes `solution`."""

    solution: wp.array
    """d [mm], shape (free nodes,), vec3."""
    residual: wp.array
    """-g - H d, shape (free nodes,), vec3."""
    search: wp.array
    """The last search direction, shape (free nodes,), vec3."""
    noise: wp.array
    """Forces that `add_noise` adds, 0 at first, shape (free nodes,), vec3."""

    def __init__(
        self, matrix: BlockMatrix, preconditioner: Preconditioner, gradient: wp.array, most_iterations: int = 1000
    ) -> None:
        """Records the launches.

        Args:
            matrix: H; what is assembled at the time of a solve counts.
            preconditioner: M, see there.
            gradient: g, whose free nodes are read at each solve, shape (nodes,), vec3.
            most_iterations: the bound of a solve.
        """
        self.model = model = matrix.model
        ranges, parallel = model.parallel.ranges, model.parallel
        self._most_iterations = most_iterations
        at, running = Iterates.zero(model, most_iterations + WINDOW + 1), model.zeros(wp.int32, 1)
        dots = [at.r_dot_z, at.p_dot_q]
        self._limits, outcome = model.zeros(wp.float64, 3), model.zeros(wp.float64, ITERATIONS + 1)
        self._set_limits: tuple[float, ...] = ()
        self._outcome, self._r_dot_z, self._p_dot_q = (
            Readback(parallel, array) for array in (outcome, at.r_dot_z.products, at.p_dot_q.products)
        )
        self.solution, self.residual, self.search = x, r, p = at.solution, at.residual, at.search
        step_and_precondition = in_sequence(matrix.update_solution(at), preconditioner.apply(at))
        iterate = in_sequence(matrix.update_search_and_multiply(at), step_and_precondition)
        kernels = conjugate_gradient_kernels(model.scalar)
        earlier, measures = model.free_vectors(), model.zeros(wp.float64, ranges, PADDING)
        self._start = model.over_free(kernels.start, [gradient], [x, r, p, earlier])
        self._measure = model.over_free(kernels.measure, [x], [earlier, measures])
        self._test_convergence = parallel.record(
            kernels.test_convergence, 1, [most_iterations, self._limits, *dots], [measures, outcome, running]
        )
        size = math.prod(at.r_dot_z.products.shape)
        self._reset = parallel.record(kernels.reset, size, [], [*dots, outcome, running])
        self._amount, self.noise = model.zeros(wp.float64, 1), model.free_vectors()
        add_noise = model.over_free(vector_kernels(model.scalar).step, [self._amount, r, self.noise], [r])

        def windows(size: int) -> Launch:
            """Iterations and a test of how far they moved the solution; the device decides when the loop ends."""
            return parallel.repeat(running, in_sequence(*[iterate] * size, self._measure, self._test_convergence))

        def run(first: Launch, size: int = WINDOW, *more: Launch) -> Launch:
            return parallel.graph(
                self._reset, first, step_and_precondition, windows(size), self._outcome.send, *more
            )

        self._run, self._run_short = run(self._start), run(self._start, SHORT_WINDOW)  # d = 0, r = -g
        coefficients = self._r_dot_z.send, self._p_dot_q.send
        self._run_with_noise = run(add_noise, WINDOW, *coefficients)
        go_on = partial(running.fill_, 1)
        self._go_on = parallel.graph(go_on, windows(WINDOW), self._outcome.send, *coefficients)

    def solve(
        self,
        absolute: float,
        relative: float,
        least_iterations: float = 0.0,
        *,
        short: bool = False,
        meanwhile: Callable[[], None] = nothing,
    ) -> LinearSolution:
        """Solves H d = -g for the gradient as it is now.

        It ends when no vector of d is estimated to be wrong by more than `absolute` [mm] or `relative` of the
        longest, and not before `least_iterations`: a residual falls long before the long waves of the solution
        have come. It also ends at a search direction of negative curvature, where the matrix has no least energy
        (Steihaug 1983). It looks in `short` windows or not. `meanwhile` is called while a
        device is at work."""
        self._limit(absolute, relative, least_iterations)
        (self._run_short if short else self._run)()
        meanwhile()
        return self.read()

    def add_noise(self, amount: float) -> LinearSolution:
        """Continues a solve that was SOLVED with an amount of `noise` added to its residual, by new iterations.

        Its solution is added to the one before.
        """
        self._limit(*self._set_limits[:2], 0.0)
        self._amount.fill_(amount)
        self._run_with_noise()
        return self.read()

    def go_on(self, least_iterations: float) -> LinearSolution:
        """Continues the last solve to a number of iterations in all, where it was SOLVED."""
        self._limit(*self._set_limits[:2], least_iterations)
        self._go_on()
        return self.read()

    def _limit(self, *limits: float) -> None:
        if limits != self._set_limits:
            self._set_limits = ()  # where it is interrupted here, they are not known
            self._limits.assign(np.array(limits))
            self._set_limits = limits

    def read(self) -> LinearSolution:
        """How the last solve ended; waits for it."""
        outcome = self._outcome.read()
        end = Outcome.SOLVED
        if not math.isfinite(outcome[SOLUTION_LENGTH]):
            end = Outcome.UNSOUND
        elif outcome[NEGATIVE_CURVATURE]:
            end = Outcome.NEGATIVE_CURVATURE
        elif outcome[ITERATIONS] >= self._most_iterations:
            end = Outcome.EXHAUSTED
        return LinearSolution(
            end,
            iterations=int(outcome[ITERATIONS]),
            length=float(outcome[SOLUTION_LENGTH]),
            error=float(outcome[ERROR]),
            gradient_norm=float(outcome[GRADIENT_NORM]),
            residual_norm=float(outcome[RESIDUAL_NORM]),
        )

    def coefficients(self) -> tuple[np.ndarray, np.ndarray]:
        """r . z and p . q of every iteration of the last solve, which had noise or was continued, float64, shape
        (iterations,) each."""
        count = int(self._outcome.read()[ITERATIONS])
        r_dot_z, p_dot_q = (each.read()[:count].sum(axis=1) for each in (self._r_dot_z, self._p_dot_q))
        return r_dot_z, p_dot_q
