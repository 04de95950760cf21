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
    """Compressed rows of the 3x3 blocks of a sparse matrix: pairs of nodes that share a stencil."""

    row_start: np.ndarray
    """First block of each row and the end of the last, shape (rows + 1,), int32."""
    columns: np.ndarray
    """Column of each block, ascending within a row, shape (blocks,), int32."""
    block_of: np.ndarray
    """The block of corner pair 4 a + b of each stencil, -1 for none, shape (stencils, 16), int32."""

    @property
    def rows(self) -> np.ndarray:
        """Row of each block, shape (blocks,), int32."""
        return np.repeat(np.arange(len(self.row_start) - 1, dtype=np.int32), np.diff(self.row_start))

    def upper_half(self, bounds: np.ndarray) -> tuple[Pattern, np.ndarray]:
        """The blocks of a square pattern on and above the diagonal, and those below it between two ranges of rows.

        Of the former it has, in `block_of`; and which of the latter is the image of each, -1 for none.
        """
        rows, columns = self.rows, self.columns
        owner = np.repeat(np.arange(len(bounds) - 1), np.diff(bounds))
        kept = np.flatnonzero((columns >= rows) | (owner[columns] != owner[rows]))
        number = np.full(len(columns) + 1, -1, dtype=np.int32)  # the last: of what is no block
        number[kept] = np.arange(len(kept))
        above, below = np.flatnonzero(columns > rows), np.flatnonzero(columns < rows)
        image = np.full(len(columns), -1)
        image[above[np.argsort(columns[above], kind="stable")]] = number[below]  # in the order of those below
        number[below] = -1
        row_start = np.searchsorted(rows[kept], np.arange(len(self.row_start)))
        return Pattern(row_start.astype(np.int32), columns[kept], number[self.block_of]), image[kept]


def equal_parts(row_start: np.ndarray, ranges: int) -> np.ndarray:
    """Ranges of rows with equally many entries, by the first of each row and the end, shape (ranges + 1,)."""
    size = len(row_start) - 1
    bounds = np.searchsorted(row_start, np.linspace(0, row_start[-1], ranges + 1)).clip(0, size)
    bounds[0], bounds[-1] = 0, size
    return bounds


def square_pattern(stencils: np.ndarray, size: int) -> Pattern:
    """The blocks of all pairs among the first `size` nodes, each node with itself also where no stencil has it.

    Args:
        stencils: four nodes that share a term of the energy, shape (stencils, 4).
        size: number of rows and columns.
    """
    edges, edge_of = unique_edges(stencils)
    inside = np.flatnonzero(edges[:, 1] < size)
    low, high = edges[inside].T
    keys = np.concatenate([np.arange(size) * (size + 1), low * size + high, high * size + low])
    order = np.argsort(keys)
    block = np.empty(len(keys), dtype=np.int32)
    block[order] = np.arange(len(keys), dtype=np.int32)
    upper, lower = np.full((2, len(edges)), -1, dtype=np.int32)
    diagonal, upper[inside], lower[inside] = np.split(block, [size, size + len(inside)])
    diagonal = np.append(diagonal, -1).take(np.minimum(stencils, size))
    row_start = np.searchsorted(keys[order], np.arange(size + 1) * max(size, 1)).astype(np.int32)
    columns = (keys[order] % max(size, 1)).astype(np.int32)
    block_of = np.empty((len(stencils), 16), dtype=np.int32)
    block_of[:, ::5] = diagonal
    for edge, (a, b) in zip(edge_of.T, EDGES, strict=True):
        ascending, above, below = stencils[:, a] < stencils[:, b], upper.take(edge), lower.take(edge)
        block_of[:, 4 * a + b] = np.where(ascending, above, below)
        block_of[:, 4 * b + a] = np.where(ascending, below, above)
    return Pattern(row_start, columns, block_of)


def unique_edges(stencils: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The edges of stencils (stencils, 4), each once and in order, and the edges of each stencil.

    Returns:
        Lower and higher node of each edge, shape (edges, 2), int64, and numbers of edges, shape (stencils, 6).
    """
    nodes = int(stencils.max(initial=0)) + 1
    ends = stencils[:, EDGES].astype(np.int64)
    keys, edge_of = np.unique(ends.min(axis=2) * nodes + ends.max(axis=2), return_inverse=True)
    return np.column_stack(np.divmod(keys, nodes)), edge_of


def edges_shared(tets: np.ndarray) -> np.ndarray:
    """In how many tetrahedra each edge of each (tets, 4) occurs, shape (tets, 6)."""
    edge_of = unique_edges(tets)[1]
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
        found = label.copy()
        lowest = np.minimum.reduce([label.take(corner) for corner in corners])
        for corner in corners:
            np.minimum.at(found, corner, lowest)
        np.minimum.at(found, label, found.copy())  # what a node has found, the one that names its piece has, too
        while not np.array_equal(found, named := found.take(found)):
            found = named
        if np.array_equal(found, label):
            return label
        label = found
