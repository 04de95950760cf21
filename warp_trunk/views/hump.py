"""How far each place of the back stands behind the other side, and its colours."""

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface

from .relief import BEHIND, Relief, Window, seen_from

COLOUR_STEP = 5.0
"""Difference between two colours of the hump [mm]."""
SCALE_END = 40.0
"""Either end of the scale on every page and in every recording [mm]; beyond it places have one colour more."""
FLANK, BACK = 0.6, 0.8
"""Where the skin faces back by less than the first it is flank, and not compared with the other side; by
more than the second it is back. Cosines of 53 and 37 degrees."""
NEAR, WIDE = 95.0, 115.0
"""Nearer to the spine than the first all of the skin is back; further than the second it is arm or flank [mm]."""
SMOOTH = 4.0
"""Painted values are smoothed over this length [mm], so that the triangles of a mesh do not show."""
PURPLE_ORANGE = (
    (45, 0, 75), (84, 39, 136), (128, 115, 172), (178, 171, 210), (216, 218, 235), (247, 247, 247),
    (254, 224, 182), (253, 184, 99), (224, 130, 20), (179, 88, 6), (127, 59, 8),
)  # fmt: skip
"""The scale, from further forward to further back: PuOr of Cynthia Brewer, for every kind of colour vision."""
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
    facing = near * np.clip((back.normal[:, :, 1] - FLANK) / (BACK - FLANK), 0.0, 1.0) * (back.cloth == 0)
    difference = back.depth - _between_columns(back.depth, column)
    return difference, np.nan_to_num(np.minimum(facing, _between_columns(facing, column)))


Painted = tuple[np.ndarray, np.ndarray]
"""How far each place stands behind the other side [mm], and how strongly that is painted, 0 to 1."""


def painted_difference(back: Relief, seen: Window) -> Painted:
    """`side_difference` as it is painted: smoothed over `SMOOTH`, and fading out at both ends of the spine."""
    from scipy.ndimage import gaussian_filter  # heavy

    difference, part = side_difference(back, seen)
    low, high = back.spine[:, 1].min(), back.spine[:, 1].max()
    along = np.clip(np.minimum(seen.z - low, high - seen.z) / FADE, 0.0, 1.0)
    finite, width = np.isfinite(difference), SMOOTH / seen.pixel  # of a Gaussian [pixels], among what is known
    weight = gaussian_filter(finite.astype(np.float64), width)
    smooth = gaussian_filter(np.where(finite, difference, 0.0), width) / np.maximum(weight, 1e-9)
    return np.where(finite, smooth, np.nan), part * along[:, None]


def _between_columns(values: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Values (rows, columns) at places between columns, linear; NaN outside. Same shape as `column`."""
    inside = (column >= 0.0) & (column <= values.shape[1] - 1)
    left = np.clip(np.nan_to_num(np.floor(column)).astype(int), 0, values.shape[1] - 2)
    part, row = column - left, np.arange(len(values))[:, None]
    return np.where(inside, (1.0 - part) * values[row, left] + part * values[row, left + 1], np.nan)


def hump_palette() -> np.ndarray:
    """Colours of what lies below the scale, of its steps from the lower end and of what lies above it, 0 to 1,
    shape (steps + 2, 3)."""
    steps, anchors = int(2.0 * SCALE_END / COLOUR_STEP), np.linspace(0.0, 1.0, len(PURPLE_ORANGE))
    place = [0.0, *np.linspace(anchors[1], anchors[-2], steps), 1.0]
    return np.column_stack([np.interp(place, anchors, channel) for channel in np.transpose(PURPLE_ORANGE)]) / 255.0


def hump_colours(difference: np.ndarray) -> np.ndarray:
    """The colours of differences of the two sides [mm], 0 to 1, shape (..., 3)."""
    palette = hump_palette()
    step = np.floor((difference + SCALE_END) / COLOUR_STEP).astype(int) + 1
    return palette[np.clip(step, 0, len(palette) - 1)]


def hump_on_vertices(skin: Surface, landmarks: Landmarks, back: Relief, seen: Window, painted: Painted) -> Painted:
    """The `painted` values at the vertices of a skin, 0 where not seen from behind; shape (vertices,) each."""
    from scipy.ndimage import map_coordinates  # heavy

    x, depth, z = seen_from(skin.vertices, landmarks, BEHIND).T
    place = [(seen.z[0] - z) / seen.pixel, (seen.x[0] - x) / seen.pixel]
    difference, part, near = (
        map_coordinates(np.nan_to_num(image), place, order=1) for image in (*painted, back.depth)
    )
    return difference, part * (np.abs(near - depth) < COLOUR_STEP)
