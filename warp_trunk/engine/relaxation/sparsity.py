"""Where the curvature of each tetrahedron goes in the sparse matrix over the free nodes; made once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from ..adjacency import Adjacency
from ..assembly import Assembly, assembly_of_rows
from ..memo import Arrays, arrays_of
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
    assembly: Assembly
    """Where curvatures go: for a pair of free nodes one block is added up, and the other is its image."""
    row_bounds: np.ndarray
    """Ranges of rows with equally many blocks, for the threads, shape (ranges + 1,)."""

    @property
    def blocks(self) -> int:
        """Number of 3x3 blocks."""
        return len(self.columns)


def find_sparsity(model: Model) -> Sparsity:
    """The pattern of the matrix: node pairs that share a tetrahedron, both free."""
    found = arrays_of(model.memo, "pattern", lambda: _pattern(model), lambda known: _is_pattern(known, model))
    row_start, columns = found["row_start"], found["columns"]
    size = model.free_nodes
    row = np.repeat(np.arange(size, dtype=np.int32), np.diff(row_start))
    bounds = np.searchsorted(row_start, np.linspace(0, len(columns), model.parallel.ranges + 1)).clip(0, size)
    bounds[0], bounds[-1] = 0, size
    return Sparsity(
        row_start=model.array(row_start, wp.int32),
        columns=model.array(columns, wp.int32),
        diagonal=model.array(np.flatnonzero(columns == row), wp.int32),
        assembly=assembly_of_rows(model, row_start, columns, found["place"]),
        row_bounds=bounds,
    )


def _pattern(model: Model) -> dict[str, np.ndarray]:
    """Compressed rows, and the place of each corner pair in its row, from 1; 0 with a prescribed corner."""
    return Adjacency(model.parallel, model.stencils_there, model.nodes).rows(model.free_nodes)


def _is_pattern(known: Arrays, model: Model) -> bool:
    row_start, columns, place = known["row_start"], known["columns"], known["place"]
    size, corners = model.free_nodes, model.stencils
    kinds = row_start.dtype, columns.dtype, place.dtype
    if (
        kinds != (np.int32, np.int32, np.uint16)
        or row_start.shape != (size + 1,)
        or place.shape != (len(corners), 16)
    ):
        return False
    count = np.diff(row_start)
    length = np.zeros(model.nodes, dtype=np.uint16)
    length[:size] = count
    length = length.take(corners)
    return bool(
        row_start[0] == 0
        and (count > 0).all()
        and columns.shape == (row_start[-1],)
        and columns.min() >= 0
        and columns.max() < size
        and all((place[:, k::4] <= length).all() for k in range(4))
        and np.count_nonzero(columns == np.repeat(np.arange(size, dtype=np.int32), count)) == size
    )
