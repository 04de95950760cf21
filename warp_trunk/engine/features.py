"""Edges and faces of tetrahedra."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
"""Corners of a tetrahedron's edges."""
FACES = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
"""Corners of a tetrahedron's faces; face k lies opposite corner k."""


def edge_lengths(p: np.ndarray) -> np.ndarray:
    """Lengths of the six edges of tetrahedra with corners p (tets, 4, 3), shape (tets, 6)."""
    x = _by_corner(p)
    return np.stack([_length(x[:, j] - x[:, i]) for i, j in EDGES], axis=1)


def face_areas(p: np.ndarray) -> np.ndarray:
    """Areas of the four faces of tetrahedra with corners p (tets, 4, 3), shape (tets, 4)."""
    x = _by_corner(p)
    return np.stack([0.5 * _length(_cross(x[:, j] - x[:, i], x[:, k] - x[:, i])) for i, j, k in FACES], axis=1)


def _by_corner(p: np.ndarray) -> np.ndarray:
    """Corners as (3, 4, tets): NumPy works several times as fast on long rows."""
    return np.ascontiguousarray(np.moveaxis(p, 0, 2)).swapaxes(0, 1)


def _cross(a: np.ndarray, b: np.ndarray) -> list[np.ndarray]:
    return [a[i] * b[j] - a[j] * b[i] for i, j in ((1, 2), (2, 0), (0, 1))]


def _length(v: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    return np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
