"""Where the curvature of each tetrahedron goes in the sparse matrix over the free nodes; made once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from warp_trunk.kernels.elements import vec16i

from ..model import Model


@dataclass(frozen=True)
class Sparsity:
    """Compressed rows of 3x3 blocks; columns ascend within a row."""

    row_start: wp.array
    """First block of each row and the end of the last, shape (free + 1,), int32."""
    columns: wp.array
    """Column of each block, shape (blocks,), int32."""
    diagonal: wp.array
    """The diagonal block of each row, shape (free,), int32."""
    block_of: wp.array
    """The block of corner pair (row, column) of each tetrahedron, -1 with a prescribed corner; (tets,), vec16i."""
    row_bounds: np.ndarray
    """Ranges of rows with equally many blocks, for the threads, shape (ranges + 1,)."""

    @property
    def blocks(self) -> int:
        """Number of 3x3 blocks."""
        return len(self.columns)


def find_sparsity(model: Model) -> Sparsity:
    """The pattern of the matrix: node pairs that share a tetrahedron, both free."""
    rows = np.repeat(model.corners, 4, axis=1).astype(np.int64)
    columns = np.tile(model.corners, (1, 4)).astype(np.int64)
    both_free = model.is_free(rows) & model.is_free(columns)
    size = model.free_nodes
    own = np.arange(size, dtype=np.int64) * (size + 1)
    key = np.concatenate([(rows * size + columns)[both_free], own])
    unique, inverse = np.unique(key, return_inverse=True)
    block_of = np.full(rows.shape, -1, dtype=np.int32)
    block_of[both_free] = inverse[: len(inverse) - size]
    row_start = np.searchsorted(unique, np.arange(size + 1, dtype=np.int64) * size).astype(np.int32)
    share = np.linspace(0, len(unique), model.parallel.ranges + 1)
    bounds = np.searchsorted(row_start, share).clip(0, size)
    bounds[0], bounds[-1] = 0, size
    return Sparsity(
        row_start=model.array(row_start, wp.int32),
        columns=model.array((unique % max(size, 1)).astype(np.int32), wp.int32),
        diagonal=model.array(np.searchsorted(unique, own).astype(np.int32), wp.int32),
        block_of=model.array(block_of, vec16i),
        row_bounds=bounds,
    )
