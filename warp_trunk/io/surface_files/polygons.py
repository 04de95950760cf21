"""Polygons cut into triangles."""

from __future__ import annotations

import numpy as np


def fans(corners: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Triangles of polygons, each a fan around its first corner, shape (m, 3), in the order of the polygons.

    Args:
        corners: vertex numbers of all polygons, one after the other.
        ends: where each polygon ends among them.

    Raises:
        ValueError: ends that do not divide the corners into polygons of three corners or more.
    """
    ends = np.asarray(ends, dtype=np.int64)
    sizes = np.diff(ends, prepend=0)
    if (ends[-1] if len(ends) else 0) != len(corners) or (sizes < 3).any():
        raise ValueError("a polygon has fewer than 3 corners, or their numbers do not add up")
    triangles = sizes - 2
    first = np.repeat(ends - sizes, triangles)
    step = np.arange(triangles.sum()) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return corners[np.column_stack([first, first + step + 1, first + step + 2])]
