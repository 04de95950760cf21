"""An open surface of points that were scanned from one side."""

from __future__ import annotations

import numpy as np

from warp_trunk.errors import InputError

from .surface import Surface

SPACING = 3.0
"""Points nearer than this are averaged [mm]."""
GAP = 15.0
"""No triangle has a side longer than this, nor than four times the usual distance of points [mm]."""


def averaged(points: np.ndarray, spacing: float = SPACING) -> np.ndarray:
    """The means of points (n, 3) in cubes of a size [mm], shape (cubes, 3)."""
    _, cube, count = np.unique(
        np.floor(points / spacing).astype(np.int64), axis=0, return_inverse=True, return_counts=True
    )
    return np.column_stack([np.bincount(cube.reshape(-1), column) for column in points.T]) / count[:, None]


def relief(points: np.ndarray, across: np.ndarray) -> Surface:
    """Triangles between points that are neighbours seen from behind, counterclockwise seen from there.

    Args:
        points: of a back [mm], shape (n, 3), scanned from behind.
        across: unit vector to the left in the axial plane, shape (2,).

    Raises:
        InputError: fewer than 100 points that are finite, or points that form no surface.
    """
    from scipy.spatial import Delaunay, KDTree  # heavy

    if points.ndim != 2 or points.shape[1:] != (3,) or len(points) < 100 or not np.isfinite(points).all():
        raise InputError(f"back: needs 100 or more finite points of shape (n, 3), not {points.shape}")
    points = averaged(points)
    seen = np.column_stack([points[:, :2] @ across, points[:, 2]])
    corners = Delaunay(seen).simplices
    usual = np.median(KDTree(points).query(points, k=2)[0][:, 1])
    side = np.linalg.norm(points[corners] - points[np.roll(corners, 1, axis=1)], axis=2).max(axis=1)
    corners = corners[side < max(GAP, 4.0 * usual)]
    if not len(corners):
        raise InputError(f"back: {len(points)} points form no surface; give the points of a scan in mm")
    (a, b), (c, d) = seen[corners[:, 1]].T - seen[corners[:, 0]].T, seen[corners[:, 2]].T - seen[corners[:, 0]].T
    corners[a * d - b * c > 0.0] = corners[a * d - b * c > 0.0][:, ::-1]  # from behind, left is on the left
    return Surface(points, corners.astype(np.int32))
