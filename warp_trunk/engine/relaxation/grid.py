"""Trilinear interpolation from the vertices of a regular grid: one level of the preconditioner."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LEAST_SUPPORT = 0.01
"""A grid vertex that reaches its points with a smaller sum of squared weights is left out."""
CORNERS = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)])
"""Corners of a cell."""


@dataclass(frozen=True)
class CoarseGrid:
    """The vertices of a regular grid that reach a set of points."""

    origin: np.ndarray
    """Vertex (0, 0, 0) [mm], shape (3,)."""
    spacing: float
    """Edge of a cell [mm]."""
    number: np.ndarray
    """Number of each vertex of the grid's box, -1 where left out, shape (nx, ny, nz)."""
    positions: np.ndarray
    """Where the numbered vertices are [mm], shape (vertices, 3)."""

    @classmethod
    def around(cls, points: np.ndarray, origin: np.ndarray, spacing: float) -> CoarseGrid:
        """The grid over points (points, 3) that nowhere lie below the origin [mm]."""
        cell, weight = weights(points, origin, spacing)
        size = cell.max(axis=0) + 2
        vertex = np.ravel_multi_index(tuple(np.moveaxis(cell[:, None] + CORNERS, 2, 0)), size)
        support = np.bincount(vertex.ravel(), (weight**2).ravel(), minlength=size.prod()).reshape(size)
        kept = support >= min(LEAST_SUPPORT, support.max())
        number = np.where(kept, np.cumsum(kept.ravel()).reshape(size) - 1, -1)
        return cls(origin, spacing, number, origin + spacing * np.argwhere(kept))

    def interpolate(self, points: np.ndarray) -> Interpolation:
        """Weights of the grid's vertices at points inside its cells [mm], shape (points, 3)."""
        cell, weight = weights(points, self.origin, self.spacing, np.array(self.number.shape) - 2)
        vertex = self.number[tuple(np.moveaxis(cell[:, None] + CORNERS, 2, 0))]
        weight = np.where(vertex >= 0, weight, 0.0)
        vertex = np.maximum(vertex, 0)
        entry = np.flatnonzero(weight.ravel() > 0.0)
        number = vertex.ravel()[entry]
        short = number.astype(np.uint16) if len(self.positions) <= 1 << 16 else number  # sorted much faster
        entry = entry[np.argsort(short, kind="stable")]
        count = np.bincount(number, minlength=len(self.positions))
        return Interpolation(
            vertex=vertex.astype(np.int32),
            weight=weight,
            row_start=np.concatenate([[0], np.cumsum(count)]).astype(np.int32),
            point=(entry // 8).astype(np.int32),
            point_weight=weight.ravel()[entry],
        )


@dataclass(frozen=True)
class Interpolation:
    """Weights of the grid vertices around each point, and the same by vertex."""

    vertex: np.ndarray
    """Vertices of the cell a point lies in, shape (points, 8), int32."""
    weight: np.ndarray
    """Their trilinear weights, 0 for a vertex left out, shape (points, 8)."""
    row_start: np.ndarray
    """First entry of each vertex in `point` and `point_weight`, shape (vertices + 1,), int32."""
    point: np.ndarray
    """Points that a vertex reaches, ascending, shape (entries,), int32."""
    point_weight: np.ndarray
    """Their weights, shape (entries,)."""


def weights(
    points: np.ndarray, origin: np.ndarray, spacing: float, last_cell: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The cell of each point, (points, 3), and the weights of its corners, (points, 8)."""
    place = (points - origin) / spacing
    cell = np.floor(place).astype(np.int64)
    if last_cell is not None:
        cell = np.minimum(cell, last_cell)
    upper = np.ascontiguousarray((place - cell).T)
    x, y, z = np.stack([1.0 - upper, upper], axis=1)  # of the lower and the upper corner along each axis
    weight = np.empty((len(points), 8))
    for corner, (i, j, k) in enumerate(CORNERS):
        weight[:, corner] = x[i] * y[j] * z[k]
    return cell, weight
