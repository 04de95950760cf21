"""The blocks that a product on the CPU reads: half of them, for the matrix is symmetric."""

from __future__ import annotations

import numpy as np
import warp as wp

from warp_trunk.kernels.row_loops import row_loops
from warp_trunk.kernels.sparse import half_kernels

from ..model import Model
from ..parallel import Launch
from .dots import Dots
from .sparsity import Sparsity


class HalfRows:
    """Copies of the blocks on and right of the diagonal, one after the other.

    What a product takes is to read the matrix. A block whose row and column belong to different threads is there
    twice, so that no thread writes to a row of another.
    """

    def __init__(self, model: Model, sparsity: Sparsity, blocks: wp.array) -> None:
        """Of the first slab of some blocks."""
        self._model, self._bounds = model, sparsity.row_bounds
        if model.free_nodes < model.parallel.least_split:
            self._bounds = self._bounds[[0, -1]]
        columns: np.ndarray = sparsity.columns.numpy()
        count: np.ndarray = np.diff(sparsity.row_start.numpy())
        row = np.repeat(np.arange(len(count), dtype=np.int32), count)
        owner = np.repeat(np.arange(len(self._bounds) - 1), np.diff(self._bounds))
        kept = np.flatnonzero((columns >= row) | (owner[columns] != owner[row]))
        row_start = np.concatenate([[0], np.cumsum(np.bincount(row[kept], minlength=len(count)))])
        mat33 = wp.types.matrix((3, 3), model.scalar)
        self._half = model.zeros(mat33, len(kept) + 1)
        self._pattern = model.array(row_start, wp.int32), model.array(columns[kept], wp.int32)
        self.take: Launch = model.parallel.record(
            half_kernels(model.scalar), len(kept), [model.array(kept, wp.int32), blocks], [self._half]
        )
        """Copies the blocks as they are now."""

    def multiply(self, p: wp.array, q: wp.array, p_dot_q: Dots) -> Launch:
        """Records q = H p with p . q; see `BlockMatrix.multiply`."""
        carried = self._model.zeros(wp.types.vector(4, self._model.scalar), len(p))
        return self._model.parallel.record(
            row_loops(self._model.scalar).multiply,
            self._bounds,
            [*self._pattern, self._half, p_dot_q.iteration, p],
            [q, p_dot_q.products, carried],
            least=0,  # the bounds are those that the blocks were taken by
            loops=True,
        )
