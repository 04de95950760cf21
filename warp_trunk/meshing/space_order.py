"""An order of nodes and tetrahedra that keeps neighbours in space near each other in memory."""

from __future__ import annotations

import numpy as np

_BITS = 21
"""Bits of each coordinate; three times this fits an integer of 64 bits."""


def morton_order(points: np.ndarray) -> np.ndarray:
    """Indices that put points (n, 3) along a Morton curve (Z-order) of their bounding cube, shape (n,)."""
    lower = points.min(axis=0)
    size = max(float((points.max(axis=0) - lower).max()), 1e-300)
    cell = np.minimum((points - lower) * (2.0**_BITS / size), 2**_BITS - 1).astype(np.uint64)
    code = _spread(cell[:, 0]) | (_spread(cell[:, 1]) << np.uint64(1)) | (_spread(cell[:, 2]) << np.uint64(2))
    return np.argsort(code, kind="stable")


def _spread(bits: np.ndarray) -> np.ndarray:
    """Put two zero bits between the bits of each number."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        bits = (bits | (bits << np.uint64(shift))) & np.uint64(mask)
    return bits
