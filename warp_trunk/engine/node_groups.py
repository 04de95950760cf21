"""Groups of nodes that stiff links tie, whose block the preconditioner inverts as a whole."""

from __future__ import annotations

import heapq
from typing import Any

import numpy as np
import warp as wp

from warp_trunk.kernels.arguments import filled
from warp_trunk.kernels.node_groups import MEMBERS, WARP, groups_type, node_group_kernels

from .linear import BlockMatrix
from .parallel import Launch

STIFF = 0.45
"""Nodes are tied whose block off the diagonal is this part of their blocks on it, by norm: one of a hundred links
of the anatomy, of the papers' energy one of twenty. Without groups the default takes 1.4 times as many linear
iterations."""


class NodeGroups:
    """The groups of nodes that stiff links tie: the preconditioner inverts their block as a whole.

    Flat and thin tetrahedra tie nodes to each other. Their common motion is soft beside that: their own blocks do
    not show it, and a grid does not reach it. What ties them is the shape of the mesh, so the groups of the trunk
    at rest serve every increment; their blocks are those of the matrix that holds."""

    members: list[list[int]]
    """The nodes of each group, ascending."""
    arrays: Any
    """Their nodes, inverses and corrections, as kernels take them; see `groups_type`."""

    def __init__(self, matrix: BlockMatrix) -> None:
        """Ties the nodes by the matrix as it is."""
        self._model = model = matrix.model
        columns, size = matrix.columns.numpy(), model.free_nodes
        rows = np.repeat(np.arange(size), np.diff(matrix.row_start.numpy()).astype(np.int64))
        upper = np.flatnonzero(columns >= rows)
        rows, columns = rows[upper], columns[upper]
        self.members = groups = tie(rows, columns, matrix.blocks.numpy()[upper], size)
        count = np.array([len(group) for group in groups], dtype=np.int64)
        keys, pairs = rows * size + columns, [(a, b) for group in groups for a in group for b in group]
        first_end, other = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        wanted = np.minimum(first_end, other) * size + np.maximum(first_end, other)
        at = np.searchsorted(keys, wanted).clip(0, len(keys) - 1)
        block_of = np.where(keys[at] == wanted, np.where(first_end <= other, 1, -1) * (upper[at] + 1), 0)
        start = 9 * np.cumsum([0, *count**2])
        nodes = np.array([node for group in groups for node in group], dtype=np.int64)
        member_of = np.full(model.free_nodes, -1)
        member_of[nodes] = np.arange(len(nodes))
        self.arrays = filled(
            groups_type(model.scalar),
            first=model.array(np.cumsum([0, *count]), wp.int32),
            start=model.array(start, wp.int32),
            nodes=model.array(nodes, wp.int32),
            inverse=model.zeros(model.scalar, int(start[-1])),
            group_of=model.array(np.repeat(np.arange(len(groups)), count), wp.int32),
            member_of=model.array(member_of, wp.int32),
            correction=model.zeros(model.vec3, max(len(nodes), 1)),
        )
        self._correct, self._bounds = node_group_kernels(model.scalar).correct, matrix.split(len(groups))
        self.update: Launch = model.parallel.record(
            node_group_kernels(model.scalar).invert,
            (WARP if model.parallel.is_cuda else 1) * self._bounds,
            [self.arrays, model.array(block_of, wp.int32), matrix.blocks, matrix.inverse_diagonal],
            [],
        )
        """Sets the groups' blocks to those of the matrix as it is, projected, and inverts them."""

    def correct(self, r: wp.array) -> Launch:
        """Records, on the CPU, the corrections for a residual of the free nodes, shape (free nodes,), vec3."""
        return self._model.parallel.record(self._correct, self._bounds, [self.arrays, r], [])


def tie(rows: np.ndarray, columns: np.ndarray, blocks: np.ndarray, size: int) -> list[list[int]]:
    """Groups of at most MEMBERS nodes, ascending, by their stiffest links.

    Nodes are tied, and groups by the blocks of their translations, always by the stiffest link, until none is
    stiff. So a thread of tissue becomes one group: no link along it is much stiffer than the next, but the longer
    a piece of it, the softer is what holds the piece.

    Args:
        rows: row of each 3x3 block on or above the diagonal of a symmetric matrix, shape (blocks,).
        columns: its column, shape (blocks,).
        blocks: the blocks, shape (blocks, 3, 3).
        size: number of nodes.
    """

    def norms(blocks: np.ndarray) -> np.ndarray:
        return np.sqrt(np.einsum("bij,bij->b", blocks, blocks))

    norm, diagonal = norms(blocks), rows == columns
    root = np.zeros(size)
    root[rows[diagonal]] = np.sqrt(np.maximum(norm[diagonal], np.finfo(norm.dtype).tiny))
    part = norm / (root[rows] * root[columns])
    stiff = (part > STIFF) & ~diagonal
    tied = np.zeros(size, dtype=bool)
    tied[rows[stiff]] = tied[columns[stiff]] = True
    links = sorted(zip((-part[stiff]).tolist(), rows[stiff].tolist(), columns[stiff].tolist(), strict=True))
    groups = {node: [node] for node in np.flatnonzero(tied).tolist()}
    held = dict(enumerate((root * root).tolist()))  # how stiffly, by norm
    near: dict[int, dict[int, np.ndarray]] = {node: {} for node in groups}  # blocks with others and with itself
    among = tied[rows] & tied[columns]
    for a, b, block in zip(rows[among].tolist(), columns[among].tolist(), blocks[among], strict=True):
        near[a][b], near[b][a] = block, block.T
    none = np.zeros((3, 3))
    into: dict[int, int] = {}  # what nodes and groups have become part of
    while links:
        _, a, b = heapq.heappop(links)
        while a in into:
            a = into[a]
        while b in into:
            b = into[b]
        if a == b or len(groups[a]) + len(groups[b]) > MEMBERS:
            continue
        into[a] = into[b] = both = size
        size += 1
        groups[both], own = groups.pop(a) + groups.pop(b), near[a][a] + near[b][b]
        own = own + near[a].get(b, none) + near[b].get(a, none)
        near[both], held[both] = {both: own}, float(np.linalg.norm(own))
        neighbours = list((near[a].keys() | near[b].keys()) - {a, b})
        for other in neighbours:
            block = near[other].pop(a, none) + near[other].pop(b, none)
            near[other][both], near[both][other] = block, block.T
        blocks = np.array([near[both][other] for other in neighbours]).reshape(-1, 3, 3)
        for other, stiffness in zip(neighbours, norms(blocks).tolist(), strict=True):
            if stiffness > STIFF * (own_norm := max(held[both] * held[other], 1e-300) ** 0.5):
                heapq.heappush(links, (-stiffness / own_norm, both, other))
    return sorted(sorted(group) for group in groups.values() if len(group) > 1)
