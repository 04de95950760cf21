"""The back coloured by its hump: how far each place stands behind the other side. Imports matplotlib."""

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from scipy.ndimage import gaussian_filter, map_coordinates

from warp_trunk.measures.hump import hump_top

from .panels import panels, shaded
from .relief import BEHIND, Relief, Window, seen_from
from .skin_pictures import lines
from .style import INK, TrunkState

COLOUR_STEP = 5.0
"""Difference between two colours of the hump [mm]."""
LEAST_LIMIT = 20.0
"""Least end of the scale [mm]."""


def hump_limit(poses: Sequence[TrunkState], reliefs: Sequence[Relief], seen: Window) -> float:
    """Where the scale of the hump ends that holds all poses [mm]."""
    differences = [painted_difference(back, seen) for back in reliefs]
    largest = [float(np.nanmax(np.where(part > 0.5, abs(one), 0.0))) for one, part in differences]
    return scale_limit([*largest, *(abs(pose.measures.max_hump or 0.0) for pose in poses)])


def hump_palette(limit: float) -> np.ndarray:
    """The colours of the steps of the scale, from its lower end, shape (steps, 3)."""
    steps = int(2.0 * limit / COLOUR_STEP)
    return colormaps["PuOr_r"](np.linspace(0.0, 1.0, steps))[:, :3]


def hump_on_vertices(pose: TrunkState, back: Relief, seen: Window) -> tuple[np.ndarray, np.ndarray]:
    """`painted_difference` on the vertices of a skin, 0 where not seen from behind; shape (vertices,) each."""
    assert pose.worn is not None
    x, depth, z = seen_from(pose.worn.skin.vertices, pose.landmarks, BEHIND).T
    place = [(seen.z[0] - z) / seen.pixel, (seen.x[0] - x) / seen.pixel]
    difference, part, near = (
        map_coordinates(np.nan_to_num(image), place, order=1)
        for image in (*painted_difference(back, seen), back.depth)
    )
    return difference, part * (np.abs(near - depth) < COLOUR_STEP)


def hump_picture(poses: Sequence[TrunkState], reliefs: Sequence[Relief], seen: Window, limit: float) -> Figure:
    """Every pose coloured by how far each place stands behind the other side of the back, with its spine; the two
    places of the largest hump are ringed. The scale ends at `limit` [mm]."""
    differences = [painted_difference(back, seen) for back in reliefs]
    bounds, palette = np.arange(-limit, limit + COLOUR_STEP, COLOUR_STEP), hump_palette(limit)
    colours, norm = ListedColormap(palette), BoundaryNorm(bounds, len(palette))
    images = [
        shaded(back, colours(norm(np.nan_to_num(difference)))[:, :, :3], part * np.isfinite(difference))
        for back, (difference, part) in zip(reliefs, differences, strict=True)
    ]
    figure, plots = panels([pose.look.heading for pose in poses], seen.extent, BEHIND, images, legend=0.95)
    for axes, pose, back, (difference, part) in zip(plots[:-1], poses, reliefs, differences, strict=True):
        compared = np.ma.masked_where(~((part > 0.5) & np.isfinite(difference)), np.nan_to_num(difference))
        steps = np.arange(10.0, limit, 10.0)
        lines(axes, seen, compared, steps.tolist(), "solid")
        lines(axes, seen, compared, (-steps[::-1]).tolist(), "dashed")
        axes.plot(*back.spine.T, "o-", color=INK, markersize=1.8, linewidth=0.7)
        level, height = pose.measures.hump_level, pose.measures.max_hump
        if level is not None and height is not None:
            tangent, z = pose.measures.tangents[level], back.spine[pose.landmarks.vertebrae().index(level)][1]
            top = None if tangent is None else hump_top(tangent)
            assert top is not None  # there is a hump
            places = seen_from(np.column_stack([top[1], [z, z]]), pose.landmarks, BEHIND)[:, 0]  # right, left
            axes.plot(
                places,
                [z, z],
                "o",
                markersize=7.0,
                markerfacecolor="none",
                markeredgecolor="white",
                markeredgewidth=2.4,
            )
            axes.plot(
                places,
                [z, z],
                "o",
                markersize=7.0,
                markerfacecolor="none",
                markeredgecolor=INK,
                markeredgewidth=1.2,
            )
            x = places[0 if height > 0.0 else 1] - np.copysign(14.0, height)
            axes.text(
                x, z + 20.0, f"{abs(height):.0f} mm", ha="center", va="center", fontsize=10,
                fontweight="bold", color=INK, path_effects=[withStroke(linewidth=2.5, foreground="white")],
            )  # fmt: skip
    ticks = np.arange(-limit, limit + 1.0, 10.0 if limit <= 40.0 else 20.0)
    bar = figure.colorbar(ScalarMappable(norm, colours), cax=plots[-1], orientation="horizontal", ticks=ticks)
    bar.ax.set_xlabel("difference from the other side of the back [mm]", fontsize=8.5)
    for x, ha, words in ((0.0, "left", "purple, dashed: further forward"), (1.0, "right", "orange: further back")):
        bar.ax.text(x, 1.35, words, transform=bar.ax.transAxes, ha=ha, va="bottom", fontsize=8.5)
    return figure


def scale_limit(sizes: Sequence[float]) -> float:
    """Where a scale ends that holds all sizes [mm], at a whole ten."""
    return 10.0 * float(np.ceil(max([LEAST_LIMIT, *sizes]) / 10.0))


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
    facing = near * np.clip((back.normal[:, :, 1] - FLANK) / (BACK - FLANK), 0.0, 1.0) * (back.cloth == 0)
    difference = back.depth - _between_columns(back.depth, column)
    return difference, np.nan_to_num(np.minimum(facing, _between_columns(facing, column)))


def painted_difference(back: Relief, seen: Window) -> tuple[np.ndarray, np.ndarray]:
    """`side_difference` as it is painted: smoothed over `SMOOTH`, and fading out at both ends of the spine."""
    difference, part = side_difference(back, seen)
    low, high = back.spine[:, 1].min(), back.spine[:, 1].max()
    along = np.clip(np.minimum(seen.z - low, high - seen.z) / FADE, 0.0, 1.0)
    known, width = np.isfinite(difference), SMOOTH / seen.pixel  # of a Gaussian [pixels], among what is known
    weight = gaussian_filter(known.astype(np.float64), width)
    smooth = gaussian_filter(np.where(known, difference, 0.0), width) / np.maximum(weight, 1e-9)
    return np.where(known, smooth, np.nan), part * along[:, None]


def _between_columns(values: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Values (rows, columns) at places between columns, linear; NaN outside. Same shape as `column`."""
    inside = (column >= 0.0) & (column <= values.shape[1] - 1)
    left = np.clip(np.nan_to_num(np.floor(column)).astype(int), 0, values.shape[1] - 2)
    part, row = column - left, np.arange(len(values))[:, None]
    return np.where(inside, (1.0 - part) * values[row, left] + part * values[row, left + 1], np.nan)
