"""The back from behind: shaded with lines of equal depth, and coloured by the hump."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .relief import Relief, Window, side_difference
from .style import FAINT, INK, Pose, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, GAP, TITLE, SIDES = 3.1, 0.2, 0.35, 0.3
"""Of a back with the space around it, of that space, of the line above and of the line below it [inches]."""
LIGHT = np.array([0.0, 0.82, 0.57])
"""Where the light comes from: behind and above, and from neither side, so that no side looks fuller by it."""
SHADOW, CLAY = np.array([0.36, 0.33, 0.31]), np.array([0.96, 0.93, 0.90])
LINE_STEP = 10.0
"""Distance in depth between two lines [mm]."""
STEEP = 0.3
"""Where the skin faces back by less than this, lines would run into each other; the cosine of 73 degrees."""
COLOUR_STEP = 5.0
"""Difference between two colours of the hump [mm]."""
HUMP_LIMIT = 30.0
"""Largest difference that has a colour of its own [mm]."""


def back_picture(poses: Sequence[Pose], reliefs: Sequence[Relief], seen: Window) -> Figure:
    """Every pose shaded, with lines through places that stand equally far back."""
    figure, plots = _backs(poses, reliefs, seen)
    highest = np.nanmax([np.nanmax(back.depth) for back in reliefs])
    lowest = np.nanmin([np.nanmin(back.depth) for back in reliefs])
    levels = LINE_STEP * np.arange(np.floor(lowest / LINE_STEP), np.ceil(highest / LINE_STEP) + 1)
    for axes, back in zip(plots, reliefs, strict=True):
        steep = ~(back.normal[:, :, 1] > STEEP)
        _lines(axes, seen, np.ma.masked_where(steep, back.depth), levels, "solid")
    return figure


def hump_picture(poses: Sequence[Pose], reliefs: Sequence[Relief], seen: Window) -> Figure:
    """Every pose coloured by how far each place stands behind the other side of the back, with its spine."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import BoundaryNorm

    bounds = np.arange(-HUMP_LIMIT, HUMP_LIMIT + COLOUR_STEP, COLOUR_STEP)
    colours, norm = colormaps["PuOr_r"], BoundaryNorm(bounds, 256, extend="both")
    figure, plots = _backs(poses, reliefs, seen, legend=0.9)
    for axes, pose, back in zip(plots, poses, reliefs, strict=False):
        difference, part = side_difference(back, seen)
        known = np.nan_to_num(difference)
        axes.imshow(
            _shaded(back, colours(norm(known))[:, :, :3], part * np.isfinite(difference)),
            extent=seen.extent,
            interpolation="antialiased",
        )
        compared = np.ma.masked_where(~((part > 0.5) & np.isfinite(difference)), known)
        for sign, style in ((1.0, "solid"), (-1.0, "dashed")):
            levels = sorted(sign * size for size in (10.0, 20.0, 30.0))
            _lines(axes, seen, compared, levels, style)
        _hump(axes, pose, back)
        axes.plot(*back.spine.T, "o-", color=INK, markersize=2.2, linewidth=0.8)
    bar = figure.colorbar(
        ScalarMappable(norm, colours), cax=plots[-1], orientation="horizontal", ticks=bounds[::2]
    )
    bar.ax.set_xlabel("difference from the other side of the back [mm]")
    for x, ha, words in (
        (0.0, "left", "purple, dashed lines: stands further forward"),
        (1.0, "right", "orange, solid lines: stands further back"),
    ):
        bar.ax.text(x, 1.3, words, transform=bar.ax.transAxes, ha=ha, va="bottom", fontsize=8)
    return figure


def _backs(
    poses: Sequence[Pose], reliefs: Sequence[Relief], seen: Window, legend: float = 0.0
) -> tuple[Figure, list[Axes]]:
    """Shaded backs in a row, all at one scale, and last a plot for a legend, with space in inches, if any."""
    left, right, bottom, top = seen.extent
    width = WIDTH * len(poses)
    tall = (WIDTH - GAP) * (top - bottom) / (left - right)
    height = TITLE + tall + SIDES + legend
    figure = new_figure(width, height)
    plots = []
    for column, (pose, back) in enumerate(zip(poses, reliefs, strict=True)):
        box = (column * WIDTH + GAP / 2.0) / width, (SIDES + legend) / height, (WIDTH - GAP) / width, tall / height
        axes = figure.add_axes(box)
        axes.imshow(_shaded(back, CLAY), extent=seen.extent, interpolation="antialiased")
        axes.autoscale(False)  # what reaches beyond the window changes no scale
        axes.set_title(pose.look.title.capitalize(), color=INK, fontweight="bold")
        axes.set_axis_off()
        for x, side in ((0.0, "left"), (1.0, "right")):
            axes.text(x, -0.015, side, transform=axes.transAxes, ha=side, va="top", fontsize=8, color=FAINT)
        plots.append(axes)
    middle, below = 0.5 * (left + right), bottom - 0.035 * (top - bottom)
    plots[-1].plot([middle + 80.0, middle - 20.0], [below, below], color=INK, linewidth=2.0, clip_on=False)
    plots[-1].text(middle - 26.0, below, "100 mm", ha="left", va="center", fontsize=8, color=INK)
    if legend:
        plots.append(figure.add_axes((GAP / 2.0 / width, 0.5 / height, 1.0 - GAP / width, 0.13 / height)))
    return figure, plots


def _shaded(back: Relief, colour: np.ndarray, part: np.ndarray | None = None) -> np.ndarray:
    """The lit skin as RGBA, transparent beside it; `colour` is that of full light, mixed in by `part`."""
    light = np.clip(np.nan_to_num(back.normal) @ LIGHT, 0.0, 1.0)[:, :, None]
    base = CLAY if part is None else CLAY + part[:, :, None] * (colour - CLAY)
    lit = (SHADOW + (1.0 - SHADOW) * light) * base
    return np.concatenate([lit, np.isfinite(back.depth)[:, :, None]], axis=2)


def _lines(axes: Axes, seen: Window, values: np.ma.MaskedArray, levels: Sequence[float], style: str) -> None:
    """Lines of equal values, from every second pixel: nobody sees the others, and they take four times as long."""
    axes.contour(seen.x[::2], seen.z[::2], values[::2, ::2], levels, colors=INK, linewidths=0.6, linestyles=style)


def _hump(axes: Axes, pose: Pose, back: Relief) -> None:
    """The height of the largest hump, beside the vertebra where it is."""
    from matplotlib.patheffects import withStroke

    level, height = pose.measures.hump_level, pose.measures.max_hump
    if level is not None and height is not None:
        x, z = back.spine[pose.landmarks.vertebrae().index(level)]
        axes.text(
            x - np.copysign(55.0, height), z, f"{abs(height):.0f} mm", ha="center", va="center", fontsize=10,
            fontweight="bold", color=INK, path_effects=[withStroke(linewidth=2.5, foreground="white")],
        )  # fmt: skip
