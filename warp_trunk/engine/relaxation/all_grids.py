"""The grids of the preconditioner on CUDA: all hang on the nodes, so that three launches apply them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import warp as wp

from warp_trunk.kernels.all_grids import (
    FEW_LANES,
    NODE_LANES,
    OCTET,
    ROW_LANES,
    VERTEX_LANES,
    all_grids_kernels,
    scale_and_shorten,
    shorten,
)

from ..model import Model
from ..parallel import Launch, in_turn, view
from .dots import Dots
from .grid import Interpolation
from .iterates import Iterates


class AllGrids:
    """Grids over the free nodes, the last the coarsest; vertices are numbered through from the coarsest on."""

    def __init__(
        self, model: Model, grids: Sequence[Interpolation], diagonals: Sequence[wp.array], inverse: np.ndarray
    ) -> None:
        """Uploads what the launches read.

        Args:
            model: the trunk.
            grids: how each hangs on the free nodes, finest first.
            diagonals: the inverse diagonal of each but the last, shape (vertices,), mat33.
            inverse: that of the last, symmetric, shape (3 vertices, 3 vertices).
        """
        self.model = model
        coarsest_first = grids[::-1]
        sizes = [grid.vertices for grid in coarsest_first]
        starts = np.cumsum([0, *sizes])
        self._coarsest, self._vertices = sizes[0], int(starts[-1])
        number = wp.uint16 if max(self._vertices, model.free_nodes) <= 1 << 16 else wp.int32
        self._kernels = all_grids_kernels(model.scalar, number)
        row_start, point, weight = zip(*(grid.by_vertex for grid in coarsest_first), strict=True)
        rows = np.concatenate([np.diff(start) for start in row_start])
        self._far = sum(
            size for size, points in zip(sizes, point, strict=True) if len(points) >= VERTEX_LANES * size
        )
        self._by_vertex = (
            model.array(np.concatenate([[0], np.cumsum(rows)]), wp.int32),
            model.array(np.concatenate(point), number),
            _shortened(model, weight),
        )
        self._by_node = (
            model.array(
                np.concatenate(
                    [grid.vertex.ravel() + start for grid, start in zip(coarsest_first, starts, strict=False)]
                ),
                number,
            ),
            _shortened(model, [grid.weight.ravel() for grid in coarsest_first]),
        )
        mat33 = wp.types.matrix((3, 3), model.scalar)
        self._inverse_diagonal = model.zeros(mat33, self._vertices - self._coarsest)
        for diagonal, start in zip(diagonals[::-1], starts[1:], strict=False):
            wp.copy(self._inverse_diagonal, diagonal, dest_offset=int(start) - self._coarsest)
        scale = np.sqrt(np.maximum(np.diagonal(inverse), np.finfo(np.float32).tiny))  # none of 16 bits overflows
        self._scale = model.array(scale, wp.float32)
        self._inverse = model.zeros(wp.float16, len(inverse), -(-len(inverse) // OCTET) * OCTET)
        given = [model.array(inverse, wp.float32), self._scale]
        wp.launch(scale_and_shorten, inverse.shape, given, [self._inverse], device=model.device)

    def apply(self, inverse_diagonal: wp.array, r: wp.array, z: wp.array, r_dot_z: Dots) -> Launch:
        """Records z = D^-1 r + the corrections of all grids, with r . z, for the inverse diagonal of the nodes."""
        return self._record(inverse_diagonal, Iterates(z, r, z, z, r, r_dot_z, r_dot_z), steps=0)

    def apply_with_steps(self, inverse_diagonal: wp.array, at: Iterates) -> tuple[Launch, Launch]:
        """Records `apply`, and the same after a step along the search direction; see `Preconditioner`."""
        return self._record(inverse_diagonal, at, steps=0), self._record(inverse_diagonal, at, steps=1)

    def _record(self, inverse_diagonal: wp.array, at: Iterates, *, steps: int) -> Launch:
        """The launches, after a step or none; without one, solution, search direction and product are not read."""
        model, kernels, record = self.model, self._kernels, self.model.parallel.record
        rows, columns = len(self._scale), self._inverse.shape[1]
        iteration, r_dot_z, p_dot_q = at.r_dot_z.iteration, at.r_dot_z.products, at.p_dot_q.products
        residual = model.zeros(wp.float32, columns)
        correction = model.zeros(wp.types.vector(4, model.scalar), self._vertices)

        def numbers(array: wp.array) -> wp.array:
            return view(array, model.scalar, 3 * len(array))

        return in_turn(
            record(
                kernels.restrict,
                self._far * VERTEX_LANES + (self._vertices - self._far) * FEW_LANES,
                [
                    steps,
                    self._coarsest,
                    self._far,
                    *self._by_vertex,
                    self._inverse_diagonal,
                    view(self._scale, wp.vec3f, self._coarsest),
                    iteration,
                    r_dot_z,
                    p_dot_q,
                    at.residual,
                    at.product,
                ],
                [view(residual, wp.vec3f, self._coarsest), correction],
            ),
            record(
                kernels.dense,
                rows * ROW_LANES,
                [steps, self._inverse, self._scale, residual],
                [view(correction, model.scalar, 4 * self._vertices), iteration],
            ),
            record(
                kernels.prolong,
                model.free_nodes * NODE_LANES,
                [
                    steps,
                    view(inverse_diagonal, model.scalar, 9 * len(inverse_diagonal)),
                    *self._by_node,
                    correction,
                    iteration,
                    p_dot_q,
                    numbers(at.search),
                    numbers(at.product),
                ],
                [numbers(at.solution), numbers(at.residual), numbers(at.preconditioned), r_dot_z],
            ),
        )


def _shortened(model: Model, weights: Sequence[np.ndarray]) -> wp.array:
    """All weights in 16 bits, made on the device: the host takes much longer."""
    given = model.array(np.concatenate(weights, dtype=np.float32), wp.float32)
    shortened = model.zeros(wp.float16, len(given))
    wp.launch(shorten, len(given), [given], [shortened], device=model.device)
    return shortened
