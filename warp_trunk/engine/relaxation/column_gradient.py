"""Preconditioned conjugate gradients for several right-hand sides at once, H x = b for each column."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import warp as wp

from warp_trunk.kernels.column_gradients import BENT, ITERATIONS, LEFT, LONG, column_gradient_kernels

from ..parallel import Launch
from .block_matrix import BlockMatrix
from .columns import Columns
from .conjugate_gradient import WINDOW
from .device_loop import record_loop


class ColumnPreconditioner(Protocol):
    """A preconditioner, see there, of several columns."""

    def apply_columns(self, columns: Columns, r: wp.array, z: wp.array, r_dot_z: wp.array) -> Launch:
        """Records z = M^-1 r with r . z of each column, for fields of the free nodes; see `Columns`."""
        ...


@dataclass(frozen=True, eq=False)
class ColumnSolutions:
    """How the solve of each column ended; arrays of shape (columns,)."""

    columns: np.ndarray
    """x, shape (columns, free nodes, 3), in the precision of the matrix."""
    residuals: np.ndarray
    """b - H x, likewise, as the iteration has it."""
    iterations: np.ndarray
    """Iterations until it was done."""
    longest: np.ndarray
    """Length of its longest vector; not finite where a vector is not."""
    left: np.ndarray
    """Error that may be left in a vector, from how the changes over WINDOW iterations shrank."""
    bent: np.ndarray
    """Whether a search direction of negative curvature was met, where it ended."""


class ColumnGradient:
    """Solves for several columns: each has its own scalars, all share the passes over matrix and preconditioner.

    A column that is done stays as it is while the others go on.
    """

    def __init__(
        self, matrix: BlockMatrix, preconditioner: ColumnPreconditioner, count: int, most_iterations: int = 500
    ) -> None:
        """Records the launches.

        Args:
            matrix: H; what is assembled at the time of a solve holds.
            preconditioner: M.
            count: most columns of a solve.
            most_iterations: the bound of a solve.
        """
        self.model = model = matrix.model
        self._layout = columns = Columns(model, count)
        self._solution, self._residual, self._search, earlier, z, q = (
            columns.field(model.free_nodes) for _ in range(6)
        )
        x, r, p = self._solution, self._residual, self._search
        self._r_dot_z, self._p_dot_q = columns.products(), columns.products()
        self._extent = model.zeros(columns.vector(model.scalar), columns.slots, 2, columns.groups)
        self._descent = model.zeros(columns.vector(wp.float64), columns.groups)
        self._going = model.zeros(wp.int32, columns.size)
        self._go_on = model.zeros(wp.int32, 1)
        self._limit = model.zeros(wp.float64, columns.size)
        self._outcome = model.zeros(wp.float64, columns.size, 6)
        keep, take, step = (columns.factors() for _ in range(3))
        kernels, nodes = column_gradient_kernels(*columns.variant), model.free_nodes
        over, of_each = columns.over_components, model.parallel.record_undivided
        self._multiply = matrix.multiply_columns(columns, p, q, self._p_dot_q)
        self._start = over(kernels.begin, nodes, [q], [x, r, earlier])
        self._precondition = preconditioner.apply_columns(columns, r, z, self._r_dot_z)
        self._aim = of_each(
            kernels.aim, columns.groups, [self._going, self._r_dot_z], [self._descent, self._outcome, keep, take]
        )
        self._turn = over(kernels.turn, nodes, [keep, take, z], [p])
        self._pace = of_each(
            kernels.pace, columns.groups, [self._descent, self._p_dot_q], [self._going, self._outcome, step]
        )
        self._advance = over(kernels.advance, nodes, [step, p, q], [x, r])
        self._window = columns.over_groups(kernels.window, nodes, [x], [earlier, self._extent])
        self._decide = of_each(
            kernels.decide,
            columns.groups,
            [most_iterations, self._limit, self._r_dot_z, self._extent],
            [self._going, self._outcome, self._go_on],
        )
        once = model.parallel.once
        self._clear, self._begin_loop = once(self._p_dot_q.zero_), once(lambda: self._go_on.fill_(1))
        self._end_loop = once(self._go_on.zero_)
        self._run = record_loop(model, self._begin, self._go_on, self._advance_window)

    def solve(
        self, right: np.ndarray, relative: float | np.ndarray, guess: np.ndarray | None = None
    ) -> ColumnSolutions:
        """Solves H x = b for columns b.

        A column is done when no vector of x is judged to be wrong by more than `relative` of the longest, as in
        `ConjugateGradient.solve`, or at a search direction of negative curvature.

        Args:
            right: b, shape (columns, free nodes, 3); as many columns as there is room for, or fewer.
            relative: part of the longest vector, one for all or for each column.
            guess: where to start, of the same shape; 0 when left out.
        """
        given, layout = len(right), self._layout
        size = np.abs(right).max(axis=(1, 2), initial=0.0)
        size[~((size > 0.0) & np.isfinite(size))] = 1.0  # float32 has a least and a greatest number
        layout.write(self._residual, right, 1.0 / size)
        if guess is None:
            self._solution.zero_()
        else:
            layout.write(self._solution, guess, 1.0 / size)
        wp.copy(self._search, self._solution)
        for array in (self._r_dot_z, self._outcome, self._extent):
            array.zero_()
        self._going.assign((np.arange(layout.size) < given).astype(np.int32))
        limits = np.ones(layout.size)
        limits[:given] = relative
        self._limit.assign(limits)
        self._run()
        outcome = self._outcome.numpy()[:given]
        return ColumnSolutions(
            columns=layout.read(self._solution, size),
            residuals=layout.read(self._residual, size),
            iterations=outcome[:, ITERATIONS].astype(int),
            longest=size * outcome[:, LONG],
            left=size * outcome[:, LEFT],
            bent=outcome[:, BENT] > 0.0,
        )

    def _begin(self) -> None:
        """r = b - H x, z = M^-1 r, for what x is at the start."""
        self._multiply()
        self._clear()
        self._start()
        self._precondition()
        self._begin_loop()

    def _advance_window(self) -> None:
        """WINDOW iterations and a look at which columns are done."""
        for _ in range(WINDOW):
            self._aim()
            self._turn()  # p = z + beta p
            self._multiply()  # q = H p
            self._pace()
            self._advance()  # x += step p, r -= step q
            self._precondition()  # z = M^-1 r
        self._window()
        self._end_loop()
        self._decide()
