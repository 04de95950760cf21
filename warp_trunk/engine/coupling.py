"""The block of the true Hessian that couples free nodes with prescribed ones: what a bone that moves pulls."""

from __future__ import annotations

import numpy as np

from .assembly import assembly_of_blocks
from .state import State
from .topology import Pattern, places_of_blocks, unique_edges


class Coupling:
    """d(gradient of the free nodes) / d(position of the prescribed ones) at a state, on the host in float64."""

    def __init__(self, state: State) -> None:
        """Takes it from the Hessian at the state as it is now; nothing of it is projected."""
        model = state.model
        self._free, self._prescribed = model.free_nodes, model.nodes - model.free_nodes
        pattern = coupling_pattern(model.stencils, model.free_nodes)
        self._row, self._column = pattern.rows, pattern.columns
        assembly = assembly_of_blocks(model, pattern.block_of, len(self._row))
        if len(self._row):
            assembly.at(state.displacement)("hessian")()
        self._blocks = assembly.blocks.numpy()[: len(self._row)].astype(np.float64)

    def times(self, moved: np.ndarray) -> np.ndarray:
        """Change of gradients (fields, free, 3) by moving prescribed nodes (fields, prescribed, 3)."""
        sums = np.zeros((len(moved), self._free, 3))
        for total, by in zip(sums, moved, strict=True):
            np.add.at(total, self._row, np.einsum("bij,bj->bi", self._blocks, by[self._column]))
        return sums

    def transposed_times(self, weights: np.ndarray) -> np.ndarray:
        """The transpose, from free nodes (fields, free, 3) to prescribed ones (fields, prescribed, 3)."""
        sums = np.zeros((len(weights), self._prescribed, 3))
        for total, by in zip(sums, weights, strict=True):
            np.add.at(total, self._column, np.einsum("bji,bj->bi", self._blocks, by[self._row]))
        return sums


def coupling_pattern(stencils: np.ndarray, size: int) -> Pattern:
    """The blocks of the first `size` nodes (rows) with all others (columns, numbered from 0)."""
    edges, edge_of = unique_edges(stencils)
    across = np.flatnonzero((edges[:, 0] < size) & (edges[:, 1] >= size))
    low, high = edges[across].T
    none = np.full(len(edges), -1, dtype=np.int32)
    upper = none.copy()
    upper[across] = np.arange(len(across))
    row_start = np.searchsorted(low, np.arange(size + 1)).astype(np.int32)
    block_of = places_of_blocks(stencils, edge_of, np.full_like(stencils, -1), upper, none)
    return Pattern(row_start, (high - size).astype(np.int32), block_of)
