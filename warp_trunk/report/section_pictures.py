"""The horizontal section of the trunk at every vertebra with its dual tangent, as small multiples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.measures.rows import sided

from .relief import in_pelvis
from .style import FAINT, Pose, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from warp_trunk.case.landmarks import Landmarks

COLUMNS = 4
BEYOND = 60.0
"""How far a dual tangent is drawn beyond its points of contact [mm]."""


def section_pictures(poses: Sequence[Pose]) -> Figure:
    """All poses over each other at every level, seen from above with the back below, in the pelvis' axes."""
    levels = list(poses[0].measures.tangents)
    rows = -(-len(levels) // COLUMNS)
    figure = new_figure(7.6, 1.42 * rows + 0.4, "constrained")
    grid = figure.subplots(max(rows, 1), COLUMNS, sharex=True, sharey=True, squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
    for axes, level in zip(grid.flat, levels, strict=False):
        for pose in poses:
            tangent = pose.measures.tangents.get(level)
            if tangent is None:
                continue
            look = pose.look
            outline = _seen(np.vstack([tangent.outline, tangent.outline[:1]]), pose.landmarks)
            axes.plot(*outline.T, color=look.colour, linestyle=look.line, linewidth=0.8, label=look.title)
            contact = _seen(np.array([tangent.left, tangent.right]), pose.landmarks)
            along = (contact[1] - contact[0]) / np.hypot(*(contact[1] - contact[0]))
            line = np.array([contact[0] - BEYOND * along, contact[1] + BEYOND * along])
            axes.plot(*line.T, color=look.colour, linestyle=look.line, linewidth=1.3)
            axes.plot(*contact.T, color=look.colour, marker=look.marker, linestyle="", markersize=2.8)
        axes.set_title(level, loc="left", fontsize=9, fontweight="bold", pad=2)
        axes.set_title(_angles([pose.measures.bsr.get(level) for pose in poses]), loc="right", fontsize=8, pad=2)
        if not axes.lines:
            axes.text(0.5, 0.4, "not measured", transform=axes.transAxes, ha="center", color=FAINT)
        axes.set_aspect("equal")
    if levels:
        grid[0, 0].invert_xaxis()
        grid[0, 0].invert_yaxis()
        for x, side in ((0.0, "left"), (1.0, "right")):
            grid[0, 0].text(x, 0.0, side, transform=grid[0, 0].transAxes, ha=side, fontsize=7, color=FAINT)
    handles = {h.get_label(): h for axes in grid.flat for h in axes.get_legend_handles_labels()[0]}
    figure.legend(handles=list(handles.values()), loc="outside upper center", ncols=max(len(handles), 1))
    return figure


def _seen(points: np.ndarray, landmarks: Landmarks) -> np.ndarray:
    """Points (n, 2) in the axes of the pelvis [mm]."""
    return in_pelvis(np.column_stack([points, np.zeros(len(points))]), landmarks)[:, :2]


def _angles(angles: Sequence[float | None]) -> str:
    """Before and predicted, and the actual one in brackets."""
    before, predicted, *actual = map(sided, angles)
    return f"{before} → {predicted}" + "".join(f" ({angle})" for angle in actual)
