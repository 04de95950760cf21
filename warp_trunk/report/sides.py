"""How far one side of a back stands behind the other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .relief import Relief, Window

FLANK, BACK = 0.6, 0.8
"""Where the skin faces back by less than the first it is flank, and not compared with the other side; by
more than the second it is back. Cosines of 53 and 37 degrees."""
NEAR, WIDE = 95.0, 115.0
"""Nearer to the spine than the first all of the skin is back; further than the second it is arm or flank [mm]."""
SMOOTH = 4.0
"""Painted values are smoothed over this length [mm], so that the triangles of a mesh do not show."""
FADE = 25.0
"""From the uppermost and the lowermost vertebra on, colours fade in over this length [mm]."""


def side_difference(back: Relief, seen: Window) -> tuple[np.ndarray, np.ndarray]:
    """How far the back stands behind its other side, at the same height and as far from the spine.

    That is what back surface rotation measures too; here for every place instead of one line for a vertebra.
    The line of the spine joins the centroids of the vertebrae; above and below them nothing is compared.

    Returns:
        The difference of depth [mm], positive where a place stands further back, NaN where it has no other
        side, shape (rows, columns); and how much of a back it is there, from 0 (flank) to 1, same shape.
    """
    order = np.argsort(back.spine[:, 1])
    spine = np.interp(seen.z, back.spine[order, 1], back.spine[order, 0], left=np.nan, right=np.nan)
    column = (seen.x[0] - 2.0 * spine[:, None] + seen.x) / seen.pixel  # of the other side
    near = np.clip((WIDE - np.abs(seen.x - spine[:, None])) / (WIDE - NEAR), 0.0, 1.0)
    facing = near * np.clip((back.normal[:, :, 1] - FLANK) / (BACK - FLANK), 0.0, 1.0)
    difference = back.depth - _between_columns(back.depth, column)
    return difference, np.nan_to_num(np.minimum(facing, _between_columns(facing, column)))


def painted_difference(back: Relief, seen: Window) -> tuple[np.ndarray, np.ndarray]:
    """`side_difference` as it is painted: smoothed over `SMOOTH`, and fading out at both ends of the spine."""
    difference, part = side_difference(back, seen)
    low, high = back.spine[:, 1].min(), back.spine[:, 1].max()
    along = np.clip(np.minimum(seen.z - low, high - seen.z) / FADE, 0.0, 1.0)
    return _smoothed(difference, SMOOTH / seen.pixel), part * along[:, None]


def _smoothed(values: np.ndarray, width: float) -> np.ndarray:
    """Values (rows, columns) under a Gaussian of a width in pixels, among those that are known; NaN stays NaN."""
    from scipy.ndimage import gaussian_filter  # heavy

    known = np.isfinite(values)
    weight = gaussian_filter(known.astype(np.float64), width)
    smooth = gaussian_filter(np.where(known, values, 0.0), width) / np.maximum(weight, 1e-9)
    return np.where(known, smooth, np.nan)


def _between_columns(values: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Values (rows, columns) at places between columns, linear; NaN outside. Same shape as `column`."""
    inside = (column >= 0.0) & (column <= values.shape[1] - 1)
    left = np.clip(np.nan_to_num(np.floor(column)).astype(int), 0, values.shape[1] - 2)
    part = column - left
    row = np.arange(len(values))[:, None]
    return np.where(inside, (1.0 - part) * values[row, left] + part * values[row, left + 1], np.nan)
