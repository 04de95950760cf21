"""The grids of the preconditioner on CUDA: all hang on the nodes, so that three launches apply them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import warp as wp

from warp_trunk.kernels.all_grids import CORNERS, QUAD, ROW_LANES, VERTEX_LANES, all_grids_kernels

from ..model import Model
from ..parallel import Launch, in_turn
from .dense_inverse import view
from .dots import Dots
from .grid import Interpolation


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
        self._kernels = all_grids_kernels(model.scalar)
        coarsest_first = grids[::-1]
        sizes = [len(grid.row_start) - 1 for grid in coarsest_first]
        starts = np.cumsum([0, *sizes])
        self._coarsest, self._vertices = sizes[0], int(starts[-1])
        rows = np.concatenate([np.diff(grid.row_start) for grid in coarsest_first])
        self._by_vertex = (
            model.array(np.concatenate([[0], np.cumsum(rows)]), wp.int32),
            model.array(np.concatenate([grid.point for grid in coarsest_first]), wp.int32),
            model.array(np.concatenate([grid.point_weight for grid in coarsest_first]), model.scalar),
        )
        self._by_node = (
            model.array(
                np.concatenate(
                    [grid.vertex.ravel() + start for grid, start in zip(coarsest_first, starts, strict=False)]
                ),
                wp.int32,
            ),
            model.array(np.concatenate([grid.weight.ravel() for grid in coarsest_first]), model.scalar),
        )
        mat33 = wp.types.matrix((3, 3), model.scalar)
        self._inverse_diagonal = model.zeros(mat33, self._vertices - self._coarsest)
        for diagonal, start in zip(diagonals[::-1], starts[1:], strict=False):
            wp.copy(self._inverse_diagonal, diagonal, dest_offset=int(start) - self._coarsest)
        padded = np.zeros((len(inverse), -(-len(inverse) // QUAD) * QUAD), dtype=np.float32)
        padded[:, : len(inverse)] = inverse
        self._inverse = model.array(padded, wp.float32)

    def apply(self, inverse_diagonal: wp.array, r: wp.array, z: wp.array, r_dot_z: Dots) -> Launch:
        """Records z = D^-1 r + the corrections of all grids, with r . z, for the inverse diagonal of the nodes."""
        model, kernels, record = self.model, self._kernels, self.model.parallel.record
        rows, padded = self._inverse.shape
        residual = model.zeros(wp.float32, padded)
        correction = model.zeros(model.vec3, self._vertices)
        return in_turn(
            record(
                kernels.restrict,
                self._vertices * VERTEX_LANES,
                [self._coarsest, *self._by_vertex, self._inverse_diagonal, r],
                [view(residual, wp.vec3f, self._coarsest), correction],
            ),
            record(
                kernels.dense,
                rows * ROW_LANES,
                [self._inverse, residual],
                [view(correction, model.scalar, rows)],
            ),
            record(
                kernels.prolong,
                model.free_nodes * CORNERS,
                [inverse_diagonal, *self._by_node, correction, r],
                [z, r_dot_z.iteration, r_dot_z.products],
            ),
        )
