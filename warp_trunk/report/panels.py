"""Pictures of trunks in a row, all at one scale, and of one trunk coloured by a number. Imports matplotlib."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from warp_trunk.views.relief import Relief, Viewpoint, Window

from .style import FAINT, INK, TrunkState, new_figure

WIDTH, GAP, TITLE, SIDES = 2.3, 0.14, 0.34, 0.3
"""Of a trunk with the space around it, of that space, of the line above and of the line below it [inches]."""
LIGHT = np.array([0.0, 0.82, 0.57])
"""Where the light comes from: the viewer and above, and from neither side, so that no side looks fuller by it."""
SHADOW, CLAY = np.array([0.36, 0.33, 0.31]), np.array([0.96, 0.93, 0.90])
MATERIALS = np.array([CLAY, [0.36, 0.42, 0.48], [0.62, 0.71, 0.78]])
"""Colours of skin, shorts and shirt."""
Extent = tuple[float, float, float, float]
"""Left, right, bottom and top edge of a picture [mm]; left is the larger one."""


def panels(
    headings: Sequence[str],
    extent: Extent,
    view: Viewpoint,
    images: Sequence[np.ndarray] = (),
    *,
    legend: float = 0.0,
    scale: float = 100.0,
) -> tuple[Figure, list[Axes]]:
    """Panels in a row with their headings, and last a plot for a legend, with space in inches, if any.

    Args:
        headings: one for each panel.
        extent: what every panel shows.
        view: from where it is seen.
        images: RGBA for every panel, shape (rows, columns, 4); empty panels when left out.
        legend: height of the space below for a legend [inches].
        scale: length of the bar below the last panel [mm].
    """
    left, right, bottom, top = extent
    width, tall = WIDTH * len(headings), (WIDTH - GAP) * (top - bottom) / (left - right)
    height = TITLE + tall + SIDES + legend
    figure, plots = new_figure(width, height), []
    for column, heading in enumerate(headings):
        box = (column * WIDTH + GAP / 2.0) / width, (SIDES + legend) / height, (WIDTH - GAP) / width, tall / height
        axes = figure.add_axes(box)
        if len(images):
            axes.imshow(images[column], extent=extent, interpolation="antialiased")
        axes.set(xlim=(left, right), ylim=(bottom, top))  # what reaches beyond changes no scale
        axes.set_title(heading, color=INK, fontweight="bold")
        axes.set_axis_off()
        for x, side, align in ((0.0, view.sides[0], "left"), (1.0, view.sides[1], "right")):
            axes.text(x, -0.015, side, transform=axes.transAxes, ha=align, va="top", fontsize=8.5, color=FAINT)
        plots.append(axes)
    start, below = 0.5 * (left + right) + 0.8 * scale, bottom - 0.045 * (left - right)
    plots[-1].plot([start, start - scale], [below, below], color=INK, linewidth=2.0, clip_on=False)
    words = {"ha": "left", "va": "center", "fontsize": 8.5, "color": INK}
    plots[-1].text(start - 1.06 * scale, below, f"{scale:g} mm", **words)
    if legend:
        plots.append(figure.add_axes((GAP / 2.0 / width, 0.5 / height, 1.0 - GAP / width, 0.13 / height)))
    return figure, plots


def shaded(
    seen: Relief, colour: np.ndarray | None = None, part: np.ndarray | None = None, skin: np.ndarray = CLAY
) -> np.ndarray:
    """The lit trunk as RGBA, uint8, transparent beside it.

    Args:
        seen: the trunk.
        colour: of full light, mixed in by `part`, shape (rows, columns, 3) or (3,).
        part: 0 to 1, shape (rows, columns).
        skin: what it is mixed into, shape as that of the colour.
    """
    body, shape = np.isfinite(seen.depth), seen.normal.shape
    light, bare = np.clip(seen.normal[body] @ LIGHT, 0.0, 1.0)[:, None], seen.cloth[body] == 0
    base = np.where(bare[:, None], np.broadcast_to(skin, shape)[body], MATERIALS[seen.cloth[body]])
    if colour is not None and part is not None:
        base += (part[body] * bare)[:, None] * (np.broadcast_to(colour, shape)[body] - base)
    image = np.empty((*body.shape, 4), np.uint8)  # matplotlib draws whole numbers several times as fast
    image[:] = [*np.round(255.0 * SHADOW * CLAY), 0]  # what edges are mixed with
    image[body, :3] = np.round(255.0 * (SHADOW + (1.0 - SHADOW) * light) * base)
    image[body, 3] = 255
    return image


@dataclass(frozen=True, kw_only=True, eq=False)
class Coating:
    """Colours of the pixels of a trunk, and their scale."""

    values: np.ndarray
    """Numbers of the pixels, shape (rows, columns)."""
    part: np.ndarray
    """How much of the colour is mixed into the skin, 0 to 1, likewise."""
    colours: str
    """The palette, as matplotlib names it."""
    norm: Normalize
    """Takes values to the palette."""
    label: str
    """Of the scale."""
    ticks: Sequence[float] | None = None
    """Of the scale; as matplotlib sets them when left out."""


def coloured(
    pose: TrunkState, seen: Window, view: Viewpoint, skin: Relief, coating: Coating
) -> tuple[Figure, Axes]:
    """One trunk with coloured pixels and the scale of the colours."""
    palette, norm = colormaps[coating.colours], coating.norm
    painted = palette(norm(np.nan_to_num(coating.values)))[:, :, :3]
    heading, image = pose.look.heading, shaded(skin, painted, coating.part)
    figure, (axes, below) = panels([heading], seen.extent, view, [image], legend=0.8)
    bar = figure.colorbar(ScalarMappable(norm, palette), cax=below, orientation="horizontal", ticks=coating.ticks)
    bar.ax.set_xlabel(coating.label, fontsize=8.5)
    return figure, axes
