"""The block of the true Hessian that couples free nodes with prescribed ones: what a bone that moves pulls."""

from __future__ import annotations

import numpy as np
import warp as wp

from .assembly import assembly_of_blocks
from .state import State
from .topology import coupling_pattern


class Coupling:
    """d(gradient of the free nodes) / d(position of the prescribed ones) at a state, on the host in float64."""

    def __init__(self, state: State) -> None:
        """Takes it from the Hessian at the state as it is now; nothing of it is projected."""
        model = state.model
        self._free, self._prescribed = model.free_nodes, model.nodes - model.free_nodes
        pattern = coupling_pattern(model.stencils, model.free_nodes)
        self._row, self._column = pattern.rows, pattern.columns
        size = len(self._row)
        blocks = model.zeros(wp.types.matrix((3, 3), model.scalar), model.parallel.ranges, max(size, 1))
        if size:
            record = assembly_of_blocks(model, pattern.block_of, size).into(blocks, state.displacement)
            record("hessian")()
        self._blocks = blocks.numpy()[0, :size].astype(np.float64)
        self._by_column = np.argsort(self._column, kind="stable")
        self._transposed = self._blocks[self._by_column].transpose(0, 2, 1)

    def times(self, moved: np.ndarray) -> np.ndarray:
        """Change of gradients (fields, free, 3) by moving prescribed nodes (fields, prescribed, 3)."""
        sums = [_sum_by(self._row, _each(self._blocks, by[self._column]), self._free) for by in moved]
        return np.reshape(sums, (len(moved), self._free, 3))

    def transposed_times(self, weights: np.ndarray) -> np.ndarray:
        """The transpose, from free nodes (fields, free, 3) to prescribed ones (fields, prescribed, 3)."""
        row, column = self._row[self._by_column], self._column[self._by_column]
        sums = [_sum_by(column, _each(self._transposed, by[row]), self._prescribed) for by in weights]
        return np.reshape(sums, (len(weights), self._prescribed, 3))


def _each(blocks: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Products of blocks (n, 3, 3) with vectors (n, 3)."""
    return np.einsum("bij,bj->bi", blocks, vectors)


def _sum_by(row: np.ndarray, values: np.ndarray, size: int) -> np.ndarray:
    """Sums of values (n, 3) by their rows, which ascend, shape (size, 3)."""
    total = np.zeros((size, 3))
    if len(row):
        starts = np.flatnonzero(np.diff(row, prepend=-1))
        total[row[starts]] = np.add.reduceat(values, starts)
    return total
