"""Edges and faces of tetrahedra, and in how many they occur."""

from __future__ import annotations

import numpy as np

EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
"""Corners of a tetrahedron's edges."""
FACES = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
"""Corners of a tetrahedron's faces; face k lies opposite corner k."""


def face_areas(p: np.ndarray) -> np.ndarray:
    """Areas of the four faces of tetrahedra with corners p (tets, 4, 3), shape (tets, 4)."""
    q = p[:, FACES]
    return 0.5 * np.linalg.norm(np.cross(q[:, :, 1] - q[:, :, 0], q[:, :, 2] - q[:, :, 0]), axis=2)


def shared_by(features: np.ndarray) -> np.ndarray:
    """For every edge or face of every tetrahedron (tets, features, corners): in how many it occurs."""
    flat = np.sort(features.reshape(-1, features.shape[2]), axis=1).astype(np.int64)
    key = flat[:, 0]
    for column in range(1, flat.shape[1]):
        key = key * (int(features.max()) + 1) + flat[:, column]
    _, inverse, counts = np.unique(key, return_inverse=True, return_counts=True)
    return counts[inverse].reshape(features.shape[:2])
