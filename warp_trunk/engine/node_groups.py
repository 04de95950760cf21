"""Groups of nodes that stiff links tie: the preconditioner inverts their block as a whole.

Flat and thin tetrahedra tie nodes to each other. Their common motion is soft beside that: their own blocks do not
show it, and a grid does not reach it. What ties them is the shape of the mesh, so the groups of the trunk at rest
serve every increment; their blocks are those of the matrix that holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from warp_trunk.kernels.node_groups import MEMBERS, WARP, node_group_kernels

from .parallel import Launch, nothing

if TYPE_CHECKING:
    from .linear import BlockMatrix, Dots

STIFF = 0.45
"""Nodes are tied whose block off the diagonal is this part of their blocks on it, by norm: one of a hundred links
of the anatomy, of the papers' energy one of twenty. With 0.5 the certificate of the default takes 100 linear
iterations, with 0.45 68, with 0.4 64; without groups 164."""


class NodeGroups:
    """The groups of a trunk on its device."""

    members: list[list[int]]
    """The nodes of each group, ascending."""

    def __init__(self, matrix: BlockMatrix) -> None:
        """Ties the nodes by the matrix as it is."""
        self._model = model = matrix.model
        columns, size = matrix.columns.numpy(), model.free_nodes
        rows = np.repeat(np.arange(size), np.diff(matrix.row_start.numpy()).astype(np.int64))
        upper = np.flatnonzero(columns >= rows)
        rows, columns = rows[upper], columns[upper]
        self.members = groups = tie(rows, columns, matrix.blocks.numpy()[upper], size)
        self.update: Launch = nothing
        """Sets the groups' blocks to those of the matrix as it is, projected, and inverts them."""
        self._count = np.array([len(group) for group in groups], dtype=np.int64)
        if not groups:
            return
        keys, pairs = rows * size + columns, [(a, b) for group in groups for a in group for b in group]
        one, other = np.array(pairs, dtype=np.int64).T
        wanted = np.minimum(one, other) * size + np.maximum(one, other)
        at = np.searchsorted(keys, wanted).clip(0, len(keys) - 1)
        block_of = np.where(keys[at] == wanted, np.where(one <= other, 1, -1) * (upper[at] + 1), 0)
        start = 9 * np.cumsum([0, *self._count**2])
        self._kernels = node_group_kernels(*model.variant)
        self._where = [
            model.array(each, wp.int32) for each in (np.cumsum([0, *self._count]), start, np.concatenate(groups))
        ]
        self._inverse = model.zeros(model.scalar, int(start[-1]))
        given = [*self._where, model.array(block_of, wp.int32), matrix.blocks, matrix.inverse_diagonal]
        self.update = self._over_groups(self._kernels.invert, WARP * len(groups), given, [self._inverse])

    def apply(self, r: wp.array, z: wp.array, r_dot_z: Dots) -> Launch:
        """Records the change of z and of r . z by the groups' blocks, after D^-1 of the nodes' own.

        Both are vectors of the free nodes, shape (free nodes,), vec3.
        """
        if not len(self._count):
            return nothing
        group_of = np.repeat(np.arange(len(self._count)), self._count)
        given = [*self._where, self._model.array(group_of, wp.int32), self._inverse, r]
        changed = [z, r_dot_z.iteration, r_dot_z.products]
        return self._over_groups(self._kernels.apply, MEMBERS * len(group_of), given, changed)

    def _over_groups(self, kernel: Any, items: int, inputs: Sequence[Any], outputs: Sequence[Any]) -> Launch:
        """Records a launch over so many items on CUDA, and a loop over the groups of each range on the CPU."""
        parallel = self._model.parallel
        size = items if parallel.is_cuda else len(self._count)
        return parallel.record(kernel, size, inputs, outputs, least=0, loops=not parallel.is_cuda)


def tie(rows: np.ndarray, columns: np.ndarray, blocks: np.ndarray, size: int) -> list[list[int]]:
    """Groups of at most MEMBERS nodes, ascending, by their stiffest links.

    Args:
        rows: row of each 3x3 block on or above the diagonal of a symmetric matrix, shape (blocks,).
        columns: its column, shape (blocks,).
        blocks: the blocks, shape (blocks, 3, 3).
        size: number of nodes.
    """
    norm, diagonal = np.sqrt(np.einsum("bij,bij->b", blocks, blocks)), rows == columns
    root = np.zeros(size)
    root[rows[diagonal]] = np.sqrt(np.maximum(norm[diagonal], np.finfo(norm.dtype).tiny))
    part = norm / (root[rows] * root[columns])
    stiff = np.flatnonzero((part > STIFF) & ~diagonal)
    stiff = stiff[np.argsort(-part[stiff], kind="stable")]
    group_of: dict[int, list[int]] = {}
    for a, b in zip(rows[stiff].tolist(), columns[stiff].tolist(), strict=True):
        one, other = group_of.setdefault(a, [a]), group_of.setdefault(b, [b])
        if one is not other and len(one) + len(other) <= MEMBERS:
            one += other
            group_of.update(dict.fromkeys(other, one))
    return sorted({id(group): sorted(group) for group in group_of.values() if len(group) > 1}.values())
