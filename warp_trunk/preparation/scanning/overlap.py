"""Which places of a scan other scans have seen too."""

from __future__ import annotations

import numpy as np

from warp_trunk.geometry.normals import vertex_areas
from warp_trunk.geometry.surface import Surface

_FACING = 0.5
"""Sheets whose normals differ by more than 60 degrees do not cover each other."""


def boundary_vertices(surface: Surface) -> np.ndarray:
    """Which vertices lie on an edge of one triangle only, shape (vertices,), bool."""
    ends = np.concatenate([surface.faces[:, [0, 1]], surface.faces[:, [1, 2]], surface.faces[:, [2, 0]]])
    ends = np.sort(ends, axis=1)
    edges, count = np.unique(ends, axis=0, return_counts=True)
    on_boundary = np.zeros(len(surface.vertices), dtype=bool)
    on_boundary[edges[count == 1]] = True
    return on_boundary


def covered_by(points: np.ndarray, normals: np.ndarray, other: Surface, reach: float) -> np.ndarray:
    """Which points lie on another scan: its nearest vertex is near, faces the same way and is not on its edge.

    Args:
        points: positions [mm], shape (n, 3).
        normals: outward, of any length, shape (n, 3).
        other: the other scan.
        reach: how far its nearest vertex may be [mm].
    """
    from scipy.spatial import KDTree  # heavy

    distance, nearest = KDTree(other.vertices).query(points, distance_upper_bound=reach)
    near = np.flatnonzero(np.isfinite(distance))
    vertex = np.asarray(nearest)[near]
    area = vertex_areas(other)[vertex]
    size = np.linalg.norm(area, axis=1) * np.linalg.norm(normals[near], axis=1)
    same = np.einsum("ni,ni->n", area, normals[near]) > _FACING * size
    covered = np.zeros(len(points), dtype=bool)
    covered[near] = same & ~boundary_vertices(other)[vertex]
    return covered


def reach_of(surface: Surface, noise: float) -> float:
    """How far a vertex may be from a point on the same place [mm]: the longest usual edge, and the noise."""
    corners = surface.vertices[surface.faces]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    return float(np.percentile(edges, 90.0)) + noise
