"""The block of the true Hessian that couples free nodes with prescribed ones: what a bone that moves pulls."""

from __future__ import annotations

import numpy as np

from .assembly import assemble_symmetric
from .state import State


class Coupling:
    """d(gradient of the free nodes) / d(position of the prescribed ones) at a state, on the host in float64."""

    def __init__(self, state: State) -> None:
        """Takes it from the Hessian of all nodes at the state as it is now; nothing of it is projected."""
        model = state.model
        self._free, self._prescribed = model.free_nodes, model.nodes - model.free_nodes
        pattern, assembly = assemble_symmetric(model, np.array([0, model.nodes]))
        assembly.at(state.displacement)("hessian")()
        across = np.flatnonzero((pattern.rows < self._free) & (pattern.columns >= self._free))
        self._row, self._column = pattern.rows[across], pattern.columns[across] - self._free
        self._blocks = assembly.blocks.numpy()[across].astype(np.float64)

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
