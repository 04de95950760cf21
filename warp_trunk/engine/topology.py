"""Topology of tetrahedra: edges, faces, the blocks of a sparse matrix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
"""Corners of a tetrahedron's edges."""
FACES = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
"""Corners of a tetrahedron's faces; face k lies opposite corner k."""


@dataclass(frozen=True, eq=False)
class Pattern:
    """Compressed rows of the 3x3 blocks of a symmetric sparse matrix, for pairs of nodes that share a stencil.

    Of those below the diagonal, which are images of those above, it may leave some out.
    """

    row_start: np.ndarray
    """First block of each row and the end of the last, shape (rows + 1,), int32."""
    columns: np.ndarray
    """Column of each block, ascending within a row, shape (blocks,), int32."""
    diagonal: np.ndarray
    """The block of each row on the diagonal, shape (rows,)."""
    image: np.ndarray
    """Of a block above the diagonal the one below that is its transpose, otherwise -1, shape (blocks,)."""
    block_of: np.ndarray
    """The block on or above the diagonal of each pair of corners, `np.triu_indices(4)`, of each stencil, -1 for
    none, shape (stencils, 10), int32."""

    @property
    def rows(self) -> np.ndarray:
        """Row of each block, shape (blocks,), int32."""
        return np.repeat(np.arange(len(self.row_start) - 1, dtype=np.int32), np.diff(self.row_start))


@dataclass(frozen=True, eq=False)
class Edges:
    """Pairs of nodes that share a stencil."""

    stencils: np.ndarray
    """Four nodes that share a term of the energy, shape (stencils, 4)."""
    ends: np.ndarray
    """Lower and higher node of each edge, each edge once and in order, shape (2, edges)."""
    edge_of: np.ndarray
    """The edge of each of EDGES of each stencil, shape (stencils, 6)."""

    @classmethod
    def among(cls, stencils: np.ndarray) -> Edges:
        """The edges of stencils, shape (stencils, 4)."""
        nodes = int(stencils.max(initial=0)) + 1
        first_end, other = (np.take(stencils, corner, axis=1).astype(np.int64) for corner in EDGES.T)
        keys = (np.minimum(first_end, other) * nodes + np.maximum(first_end, other)).ravel()
        order = np.argsort(keys)
        keys = keys[order]
        first = np.ones(len(keys), dtype=bool)
        first[1:] = keys[1:] != keys[:-1]
        edge_of = np.empty(len(keys), dtype=np.int32)
        edge_of[order] = np.cumsum(first, dtype=np.int32) - 1
        return cls(stencils, np.array(np.divmod(keys[first], nodes)), edge_of.reshape(-1, len(EDGES)))

    def renumbered(self, number: np.ndarray) -> Edges:
        """The same where each node has another number, shape (nodes,)."""
        first_end, other = number.take(self.ends)
        low, high = np.minimum(first_end, other), np.maximum(first_end, other)
        order = np.lexsort((high, low))
        place = np.empty(len(order), dtype=np.int32)
        place[order] = np.arange(len(order))
        return Edges(number.take(self.stencils), np.array([low[order], high[order]]), place.take(self.edge_of))

    def row_start(self, size: int) -> np.ndarray:
        """First block of each row of the whole matrix over the first nodes, and the end, shape (size + 1,)."""
        inside = self.ends[:, self.ends[1] < size]
        return np.concatenate([[0], np.cumsum(1 + np.bincount(inside.ravel(), minlength=size))])

    def pattern(self, owner: np.ndarray) -> Pattern:
        """The blocks of a matrix over the first nodes, whose rows have owners, shape (rows,).

        Each row has one on the diagonal. Below it are those whose row and column have different owners.
        """
        size = len(owner)
        inside = np.flatnonzero(self.ends[1] < size)
        low, high = self.ends[:, inside]
        below = np.flatnonzero(owner[low] != owner[high])
        below = below[np.argsort(high[below], kind="stable")]  # by row, then column
        above_before = np.searchsorted(low, np.arange(size + 1))  # a row: blocks above and below the diagonal
        below_before = np.searchsorted(high[below], np.arange(size + 1))
        row_start = np.arange(size + 1) + above_before + below_before
        diagonal = np.arange(size) + above_before[:-1] + below_before[1:]
        above = np.arange(len(low)) + low + 1 + below_before[low + 1]
        mirrored = np.arange(len(below)) + high[below] + above_before[high[below]]
        columns, image = np.empty(row_start[-1], dtype=np.int32), np.full(row_start[-1], -1)
        columns[diagonal], columns[above], columns[mirrored] = np.arange(size), high, low[below]
        image[above[below]] = mirrored
        number = np.full(self.ends.shape[1], -1, dtype=np.int32)
        number[inside] = above
        row, other = np.triu_indices(4)
        block_of = np.empty((len(self.stencils), len(row)), dtype=np.int32)
        block_of[:, row < other] = number.take(self.edge_of)
        block_of[:, row == other] = np.append(diagonal, -1).take(np.minimum(self.stencils, size))
        return Pattern(row_start.astype(np.int32), columns, diagonal, image, block_of)


def equal_parts(row_start: np.ndarray, ranges: int) -> np.ndarray:
    """Ranges of rows with equally many entries, by the first of each row and the end, shape (ranges + 1,)."""
    size = len(row_start) - 1
    bounds = np.searchsorted(row_start, np.linspace(0, row_start[-1], ranges + 1)).clip(0, size)
    bounds[0], bounds[-1] = 0, size
    return bounds


def edges_shared(tets: np.ndarray) -> np.ndarray:
    """In how many tetrahedra each edge of each (tets, 4) occurs, shape (tets, 6)."""
    edge_of = Edges.among(tets).edge_of
    return np.bincount(edge_of.ravel())[edge_of]


def faces_shared(tets: np.ndarray) -> np.ndarray:
    """In how many tetrahedra each face of each (tets, 4) occurs, 1 or 2, shape (tets, 4)."""
    low, middle, high = np.moveaxis(np.sort(tets[:, FACES], axis=2), 2, 0).astype(np.int64)
    nodes = int(tets.max(initial=0)) + 1
    _, edge = np.unique(low * nodes + middle, return_inverse=True)  # its number, so that no product overflows
    _, face, count = np.unique(edge * nodes + high, return_inverse=True, return_counts=True)
    return count[face]


def find_pieces(cells: np.ndarray, nodes: int) -> np.ndarray:
    """The lowest node of the connected piece that each node is in, shape (nodes,).

    Cells (cells, corners) are tetrahedra, triangles or edges, whose corners they connect.
    """
    corners, label = np.ascontiguousarray(cells.T), np.arange(nodes)
    while True:
        lowest_near = label.copy()
        lowest = np.minimum.reduce([label.take(corner) for corner in corners])
        for corner in corners:
            np.minimum.at(lowest_near, corner, lowest)
        # what a node has found, the one that names its piece has, too
        np.minimum.at(lowest_near, label, lowest_near.copy())
        while not np.array_equal(lowest_near, named := lowest_near.take(lowest_near)):
            lowest_near = named
        if np.array_equal(lowest_near, label):
            return label
        label = lowest_near
