"""Pictures of trunks in a row, all at one scale."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .relief import Relief, Viewpoint, Window
from .style import FAINT, INK, Pose, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, GAP, TITLE, SIDES = 2.3, 0.14, 0.34, 0.3
"""Of a trunk with the space around it, of that space, of the line above and of the line below it [inches]."""
LIGHT = np.array([0.0, 0.82, 0.57])
"""Where the light comes from: the viewer and above, and from neither side, so that no side looks fuller by it."""
SHADOW, CLAY = np.array([0.36, 0.33, 0.31]), np.array([0.96, 0.93, 0.90])


def panels(
    poses: Sequence[Pose], seen: Window, view: Viewpoint, images: Sequence[np.ndarray], legend: float = 0.0
) -> tuple[Figure, list[Axes]]:
    """Trunks in a row with their titles, and last a plot for a legend, with space in inches, if any.

    Args:
        poses: what is shown.
        seen: the window of all images.
        view: from where they are seen.
        images: RGBA for every pose, shape (rows, columns, 4).
        legend: height of the space below for a legend [inches].
    """
    left, right, bottom, top = seen.extent
    width = WIDTH * len(poses)
    tall = (WIDTH - GAP) * (top - bottom) / (left - right)
    height = TITLE + tall + SIDES + legend
    figure = new_figure(width, height)
    plots = []
    for column, (pose, image) in enumerate(zip(poses, images, strict=True)):
        box = (column * WIDTH + GAP / 2.0) / width, (SIDES + legend) / height, (WIDTH - GAP) / width, tall / height
        axes = figure.add_axes(box)
        axes.imshow(image, extent=seen.extent, interpolation="antialiased")
        axes.autoscale(False)  # what reaches beyond the window changes no scale
        axes.set_title(pose.look.heading, color=INK, fontweight="bold")
        axes.set_axis_off()
        for x, side, align in ((0.0, view.sides[0], "left"), (1.0, view.sides[1], "right")):
            axes.text(x, -0.015, side, transform=axes.transAxes, ha=align, va="top", fontsize=8.5, color=FAINT)
        plots.append(axes)
    scale_bar(plots[-1], seen.extent, 100.0)
    if legend:
        plots.append(figure.add_axes((GAP / 2.0 / width, 0.5 / height, 1.0 - GAP / width, 0.13 / height)))
    return figure, plots


def scale_bar(axes: Axes, extent: tuple[float, float, float, float], length: float) -> None:
    """A bar of a length [mm] below a picture of an extent: left, right, bottom and top [mm]."""
    left, right, bottom, _ = extent
    start, below = 0.5 * (left + right) + 0.8 * length, bottom - 0.045 * (left - right)
    axes.plot([start, start - length], [below, below], color=INK, linewidth=2.0, clip_on=False)
    end = start - 1.06 * length
    axes.text(end, below, f"{length:g} mm", ha="left", va="center", fontsize=8.5, color=INK)


def shaded(seen: Relief, colour: np.ndarray | None = None, part: np.ndarray | None = None) -> np.ndarray:
    """The lit skin as RGBA, transparent beside it; `colour` is that of full light, mixed in by `part`."""
    light = np.clip(np.nan_to_num(seen.normal) @ LIGHT, 0.0, 1.0)[:, :, None]
    base = CLAY if colour is None or part is None else CLAY + part[:, :, None] * (colour - CLAY)
    lit = (SHADOW + (1.0 - SHADOW) * light) * base
    return np.concatenate([lit, np.isfinite(seen.depth)[:, :, None]], axis=2)
