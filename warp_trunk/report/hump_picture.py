"""The back coloured by its hump: how far each place stands behind the other side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .panels import panels, shaded
from .relief import BEHIND, Relief, Window
from .sides import painted_difference
from .skin_pictures import lines
from .style import INK, Pose

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOUR_STEP = 5.0
"""Difference between two colours of the hump [mm]."""
LEAST_LIMIT = 20.0
"""The scale reaches at least so far [mm]."""


def hump_picture(poses: Sequence[Pose], reliefs: Sequence[Relief], seen: Window) -> Figure:
    """Every pose coloured by how far each place stands behind the other side of the back, with its spine."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import BoundaryNorm

    differences = [painted_difference(back, seen) for back in reliefs]
    limit = scale_limit([*_largest(differences), *(abs(pose.measures.max_hump or 0.0) for pose in poses)])
    bounds = np.arange(-limit, limit + COLOUR_STEP, COLOUR_STEP)
    colours, norm = colormaps["PuOr_r"], BoundaryNorm(bounds, 256)
    images = [
        shaded(back, colours(norm(np.nan_to_num(difference)))[:, :, :3], part * np.isfinite(difference))
        for back, (difference, part) in zip(reliefs, differences, strict=True)
    ]
    figure, plots = panels(poses, seen, BEHIND, images, legend=0.95)
    for axes, pose, back, (difference, part) in zip(plots[:-1], poses, reliefs, differences, strict=True):
        compared = np.ma.masked_where(~((part > 0.5) & np.isfinite(difference)), np.nan_to_num(difference))
        steps = np.arange(10.0, limit, 10.0)
        lines(axes, seen, compared, steps.tolist(), "solid")
        lines(axes, seen, compared, (-steps[::-1]).tolist(), "dashed")
        axes.plot(*back.spine.T, "o-", color=INK, markersize=1.8, linewidth=0.7)
        _hump(axes, pose, back)
    ticks = np.arange(-limit, limit + 1.0, 10.0 if limit <= 40.0 else 20.0)
    bar = figure.colorbar(ScalarMappable(norm, colours), cax=plots[-1], orientation="horizontal", ticks=ticks)
    bar.ax.set_xlabel("difference from the other side of the back [mm]", fontsize=8.5)
    for x, ha, words in ((0.0, "left", "purple, dashed: further forward"), (1.0, "right", "orange: further back")):
        bar.ax.text(x, 1.35, words, transform=bar.ax.transAxes, ha=ha, va="bottom", fontsize=8.5)
    return figure


def scale_limit(sizes: Sequence[float]) -> float:
    """Where a scale ends that holds all sizes [mm], at a whole ten."""
    return 10.0 * float(np.ceil(max([LEAST_LIMIT, *sizes]) / 10.0))


def _largest(differences: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[float]:
    """The largest difference that is painted, of every pose [mm]."""
    return [float(np.nanmax(np.where(part > 0.5, abs(difference), 0.0))) for difference, part in differences]


def _hump(axes: Axes, pose: Pose, back: Relief) -> None:
    """The height of the largest hump, beside the vertebra where it is."""
    from matplotlib.patheffects import withStroke

    level, height = pose.measures.hump_level, pose.measures.max_hump
    if level is not None and height is not None:
        x, z = back.spine[pose.landmarks.vertebrae().index(level)]
        axes.text(
            x - np.copysign(62.0, height), z, f"{abs(height):.0f} mm", ha="center", va="center", fontsize=10,
            fontweight="bold", color=INK, path_effects=[withStroke(linewidth=2.5, foreground="white")],
        )  # fmt: skip
