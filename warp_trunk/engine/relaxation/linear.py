"""The Newton system H d = -g by preconditioned conjugate gradients."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import warp as wp

from warp_trunk.kernels.conjugate_gradient import LEFT, LONG, conjugate_gradient_kernels
from warp_trunk.kernels.slabs import slab_kernels
from warp_trunk.kernels.sparse import sparse_kernels

from ..state import State
from .multilevel import Multilevel
from .sparsity import find_sparsity

PADDING = 8
"""Doubles between two ranges' parts of a product: a cache line."""


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


class LinearSystem:
    """The curvature of a trunk as a sparse matrix with its preconditioner, and the solver's vectors.

    Made once for a state, at rest; `assemble` follows it, `solve` writes `solution`.
    """

    solution: wp.array
    """The Newton direction d [mm], shape (free,), vec3."""

    def __init__(self, state: State, most_iterations: int = 500) -> None:
        """Finds the pattern, assembles the curvature at the state and builds the preconditioner from it."""
        self.model = model = state.model
        self.most_iterations = most_iterations
        free, ranges = model.free, model.parallel.ranges
        scalar, vec3 = model.scalar, model.vec3
        mat33 = wp.types.matrix((3, 3), scalar)
        self.sparsity = find_sparsity(model)
        self.blocks = model.array(None, mat33, (ranges, self.sparsity.blocks))
        self.inverse_diagonal = model.array(None, mat33, (free,))
        self.solution, self._earlier, self._residual, self._search, self._product, self._preconditioned = (
            model.array(None, vec3, (free,)) for _ in range(6)
        )
        rows = (most_iterations + WINDOW + 1, PADDING * ranges)
        self._r_dot_z = model.array(None, wp.float64, rows)
        self._p_dot_q = model.array(None, wp.float64, rows)
        self._iteration = model.array(None, wp.int32, (1,))
        self._go_on = model.array(None, wp.int32, (1,))
        self._limits = model.array(None, wp.float64, (3,))
        self._outcome = model.array(None, wp.float64, (3,))
        extent = model.array(None, wp.float64, (ranges, PADDING))
        self._clear, self._gather = (
            model.parallel.record(kernel, self.sparsity.blocks, [ranges], [self.blocks])
            for kernel in (slab_kernels(mat33).clear, slab_kernels(mat33).gather)
        )
        self._add_curvature = model.parallel.record(
            model.elements.kernels.curvature,
            len(model.corners),
            [model.tets, *model.elements.arguments, self.sparsity.block_of, state.displacement],
            [self.blocks],
        )
        self._invert_diagonal = model.parallel.record(
            sparse_kernels(*model.variant).invert_diagonal,
            free,
            [self.sparsity.diagonal, self.blocks, scalar(1.0)],
            [self.inverse_diagonal],
        )
        self.assemble()
        self._preconditioner = Multilevel(
            model,
            self.sparsity,
            self.blocks,
            self.inverse_diagonal,
            self._residual,
            self._preconditioned,
            self._iteration,
            self._r_dot_z,
        )
        self._record_iteration(extent)
        self._run = self._record_solve(state.gradient)

    def _record_iteration(self, extent: wp.array) -> None:
        model, s = self.model, self.sparsity
        free, ranges = model.free, model.parallel.ranges
        kernels, record = conjugate_gradient_kernels(*model.variant), model.parallel.record
        self._multiply = record(
            sparse_kernels(*model.variant).multiply,
            s.row_bounds,
            [s.row_start, s.columns, self.blocks, self._iteration, self._search],
            [self._product, self._p_dot_q],
        )
        self._advance = record(
            kernels.advance,
            free,
            [ranges, self._iteration, self._r_dot_z, self._p_dot_q, self._search, self._product],
            [self.solution, self._residual],
        )
        self._window = record(kernels.window, free, [self.solution], [self._earlier, extent])
        self._turn = record(
            kernels.turn, free, [ranges, self._iteration, self._r_dot_z, self._preconditioned], [self._search]
        )
        self._count = model.parallel.record_atomic_write(kernels.count, 1, [], [self._iteration])
        self._decide = model.parallel.record_atomic_write(
            kernels.decide,
            1,
            [ranges, self.most_iterations, self._limits, self._r_dot_z, self._iteration],
            [extent, self._outcome, self._go_on],
        )

    def assemble(self) -> None:
        """Sets the matrix to the curvature at the state, projected to positive semidefinite."""
        self._clear()
        self._add_curvature()
        if self.model.parallel.ranges > 1:
            self._gather()
        self._invert_diagonal()

    def solve(self, absolute: float, relative: float, least: float) -> LinearSolution:
        """Solves H d = -g for the gradient of the state.

        It ends when no vector of d is judged to be wrong by more than `absolute` [mm] or `relative` of the
        longest, and not before `least` iterations: a residual falls long before the long waves of the solution
        have come.
        """
        self._limits.assign(np.array([absolute, relative, least]))
        self._run()
        outcome = self._outcome.numpy()
        return LinearSolution(int(self._iteration.numpy()[0]), float(outcome[LONG]), float(outcome[LEFT]))

    def _record_solve(self, gradient: wp.array) -> Callable[[], None]:
        """The whole solve for a gradient: a loop here on the CPU, one graph with its loop on CUDA."""
        start = self.model.parallel.record(
            conjugate_gradient_kernels(*self.model.variant).start,
            self.model.free,
            [gradient],
            [self.solution, self._residual, self._search, self._earlier],
        )

        def begin() -> None:
            for array in (self._r_dot_z, self._p_dot_q, self._iteration, self._outcome):
                array.zero_()
            start()
            self._preconditioner.apply(ahead=0)
            self._go_on.fill_(1)

        if self.model.parallel.is_cuda:
            wp.capture_begin(self.model.device)
            begin()
            wp.capture_while(self._go_on, self._advance_window)
            graph = wp.capture_end(self.model.device)
            return lambda: wp.capture_launch(graph)

        def solve() -> None:
            begin()
            while self._go_on.numpy()[0]:
                self._advance_window()

        return solve

    def _advance_window(self) -> None:
        """WINDOW iterations and a look at how far they moved the solution."""
        for _ in range(WINDOW):
            self._turn()
            self._multiply()
            self._advance()
            self._preconditioner.apply(ahead=1)
            self._count()
        self._window()
        self._decide()
