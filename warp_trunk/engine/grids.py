"""Regular grids laid over the trunk at rest, coarse over fine, and their trilinear interpolation to nodes."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .dense_inverse import DenseInverse

LEAST_SUPPORT = 0.01
"""A grid vertex that reaches its points with a smaller sum of squared weights is left out."""
DENSE_CELLS = 480
"""Most cells of the coarsest grid that hold nodes; about as many vertices, three rows of the inverse for each."""
FINEST_SPACING = 1.15
"""No grid is finer than this many mean distances of nodes: below, the nodes' own blocks do the work."""
OFFSETS = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)])
"""Corners of a cell."""


@dataclass(frozen=True, eq=False)
class CoarseGrid:
    """The vertices of a regular grid that reach a set of points."""

    origin: np.ndarray
    """Vertex (0, 0, 0) [mm], shape (3,)."""
    spacing: float
    """Edge of a cell [mm]."""
    rank: tuple[np.ndarray, ...]
    """Place of each plane of the grid, along x, y and z, in the box of the planes beside points."""
    number: np.ndarray
    """Number of each vertex of that box, -1 where left out, shape (nx, ny, nz)."""
    positions: np.ndarray
    """Where the numbered vertices are [mm], shape (vertices, 3)."""

    @classmethod
    def around(cls, points: np.ndarray, origin: np.ndarray, spacing: float) -> tuple[CoarseGrid, Interpolation]:
        """The grid over points (points, 3), none of them below the origin [mm], and its interpolation to them."""
        cell, weight = weights(points, origin, spacing)
        rank = tuple(map(ranks, cell))
        size = np.array([along[-1] + 1 for along in rank])
        support = np.zeros(size.prod())
        vertex = _corners(_placed(cell, rank), size)
        for own, part in zip(vertex, weight, strict=True):
            support += np.bincount(own, part**2, minlength=len(support))
        supported = (support >= min(LEAST_SUPPORT, support.max())).reshape(size)
        axes = np.argsort(-size, kind="stable")  # layers across the longest axis follow each other: see `invert`
        place = np.empty((np.count_nonzero(supported), 3), dtype=np.int64)
        place[:, axes] = np.argwhere(supported.transpose(axes))
        number = np.full(size, -1, dtype=np.int32)
        number[tuple(place.T)] = np.arange(len(place))
        planes = [np.searchsorted(along, at) for along, at in zip(rank, place.T, strict=True)]
        grid = cls(origin, spacing, rank, number, origin + spacing * np.transpose(planes))
        return grid, grid._between(vertex, weight)

    def interpolate(self, points: np.ndarray) -> Interpolation:
        """Weights of the grid's vertices at points inside its cells [mm], shape (points, 3)."""
        last_cell = np.array([len(along) - 2 for along in self.rank])
        cell, weight = weights(points, self.origin, self.spacing, last_cell)
        return self._between(_corners(_placed(cell, self.rank), np.array(self.number.shape)), weight)

    def _between(self, corner: np.ndarray, weight: np.ndarray) -> Interpolation:
        """The interpolation by corners in the grid's box and their weights, both of shape (8, points)."""
        vertex = self.number.ravel().take(corner)
        weight[vertex < 0] = 0.0
        return Interpolation(
            vertex=np.ascontiguousarray(np.maximum(vertex, 0).T),
            weight=np.ascontiguousarray(weight.T),
            vertices=len(self.positions),
        )


def lay_grids(points: np.ndarray) -> tuple[tuple[CoarseGrid, ...], tuple[Interpolation, ...]]:
    """Grids over points (points, 3) [mm], finest first, and the interpolation of each to them."""
    spacings = find_spacings(points)
    origin = points.min(axis=0) - 1e-3 * spacings[-1]

    def lay(spacing: float) -> tuple[CoarseGrid, Interpolation]:
        return CoarseGrid.around(points, origin, spacing)

    with ThreadPoolExecutor(len(spacings)) as pool:  # NumPy releases the interpreter lock
        laid, to_points = zip(*pool.map(lay, spacings), strict=True)
    return laid, to_points


@dataclass(frozen=True, eq=False)
class Grids:
    """The grids of a trunk on the host, and what is solved on the coarsest."""

    laid: tuple[CoarseGrid, ...]
    """The grids, finest first."""
    to_nodes: tuple[Interpolation, ...]
    """The interpolation of each to the free nodes."""
    inverse: DenseInverse
    """Of the matrix on the coarsest at rest, of 3 rows a vertex."""

    def reaching(self, nodes: int) -> tuple[tuple[CoarseGrid, ...], tuple[Interpolation, ...]]:
        """The grids and their interpolations to so many nodes, of which they do not reach the last."""
        return self.laid, tuple(each.among(nodes) for each in self.to_nodes)


@dataclass(frozen=True, eq=False)
class Interpolation:
    """Weights of the grid vertices around each point."""

    vertex: np.ndarray
    """Vertices of the cell a point lies in, shape (points, 8), int32."""
    weight: np.ndarray
    """Their trilinear weights, 0 for a vertex left out, shape (points, 8)."""
    vertices: int
    """Number of vertices of the grid."""

    def among(self, points: int) -> Interpolation:
        """The same among more points, of which the grid does not reach the last."""
        more = [(0, points - len(self.vertex)), (0, 0)]
        return Interpolation(np.pad(self.vertex, more), np.pad(self.weight, more), self.vertices)

    @cached_property
    def by_vertex(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The same by vertex.

        That is: its first entry in the two other arrays (vertices + 1,), int32, the points that it reaches,
        ascending, int32, and their weights.
        """
        entry = np.flatnonzero(self.weight.ravel() > 0.0)
        number = self.vertex.ravel()[entry]
        short = number.astype(np.uint16) if self.vertices <= 1 << 16 else number  # sorted much faster
        entry = entry[np.argsort(short, kind="stable")]
        count = np.bincount(number, minlength=self.vertices)
        row_start = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
        return row_start, (entry // 8).astype(np.int32), self.weight.ravel()[entry]


def weights(
    points: np.ndarray, origin: np.ndarray, spacing: float, last_cell: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The cell of each point, (3, points), and the weights of its corners, (8, points)."""
    place = np.ascontiguousarray(((points - origin) / spacing).T)
    cell = np.floor(place).astype(np.int64)
    if last_cell is not None:
        cell = np.minimum(cell, last_cell[:, None])
    upper = place - cell
    x, y, z = np.stack([1.0 - upper, upper], axis=1)  # of the lower and the upper corner along each axis
    return cell, np.stack([x[i] * y[j] * z[k] for i, j, k in OFFSETS])


def ranks(cell: np.ndarray) -> np.ndarray:
    """The place of each plane of a grid, along one axis, among those beside the cells (points,) that hold points.

    Between pieces of tissue far apart there are none: the box of all planes would be too large for the memory."""
    beside = np.zeros(int(cell.max()) + 2, dtype=bool)
    beside[cell] = True
    beside[1:] |= beside[:-1]
    return np.cumsum(beside) - 1


def _placed(cell: np.ndarray, rank: tuple[np.ndarray, ...]) -> np.ndarray:
    """Cells (3, cells) of a grid in the box of its planes beside points."""
    return np.stack([along[at] for along, at in zip(rank, cell, strict=True)])


def _corners(cell: np.ndarray, size: np.ndarray) -> np.ndarray:
    """The corners of cells (3, cells) in the box of a grid, in C order, shape (8, cells)."""
    strides = np.array([size[1] * size[2], size[2], 1])
    return (OFFSETS @ strides)[:, None] + strides @ cell


def find_spacings(points: np.ndarray) -> list[float]:
    """Spacings of the grids over points (points, 3), finest first, each twice the one before [mm]."""
    coarsest = float(np.ptp(points, axis=0).max(initial=1e-6))
    most = min(DENSE_CELLS, len(points) / 8)
    along = np.ascontiguousarray((points - points.min(axis=0)).T)
    while occupied_cells(along, coarsest / 1.1) <= most:
        coarsest /= 1.1
    quarter = 0.25 * coarsest
    node_distance = quarter * (occupied_cells(along, quarter) / len(points)) ** (1.0 / 3.0)
    spacings = [coarsest]
    while 0.5 * spacings[0] >= FINEST_SPACING * node_distance:
        spacings.insert(0, 0.5 * spacings[0])
    return spacings


def occupied_cells(along: np.ndarray, spacing: float) -> int:
    """Number of cells of a regular grid that hold a point, by its distance along each axis, (3, points)."""
    cells = (along / spacing).astype(np.int64)
    x, y, z = map(ranks, cells)
    rows, size = y[-1] + 1, z[-1] + 1
    occupied = np.zeros((x[-1] + 1) * rows * size, dtype=bool)
    occupied[(x * rows * size)[cells[0]] + (y * size)[cells[1]] + z[cells[2]]] = True
    return int(np.count_nonzero(occupied))
