"""Back surface rotation by vertebral level, as Fig. 4.7 of [2]."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .style import INK, Pose, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def rotation_plot(poses: Sequence[Pose]) -> Figure:
    """The angle of every pose at every level, top to bottom; a level that was not measured leaves a gap."""
    levels = list(poses[0].measures.bsr)
    figure = new_figure(6.4, 1.4 + 0.2 * max(len(levels), 8), "constrained")
    axes = figure.subplots()
    axes.axvline(0.0, color=INK, linewidth=0.8)
    for pose in poses:
        angles = [pose.measures.bsr.get(level) for level in levels]
        axes.plot(
            [float("nan") if angle is None else angle for angle in angles],
            range(len(levels)),
            color=pose.look.colour,
            marker=pose.look.marker,
            linestyle=pose.look.line,
            markersize=5.0,
            linewidth=1.3,
            label=pose.look.title,
        )
    axes.set_yticks(range(len(levels)), levels)
    axes.set_ylim(len(levels) - 0.4, -0.6)
    least, most = axes.get_xlim()
    axes.set_xlim(min(least, -2.0), max(most, 2.0))
    axes.grid()
    axes.set_xlabel("← left side further back      back surface rotation [degrees]      right side further back →")
    axes.set_ylabel("vertebra")
    figure.legend(loc="outside upper center", ncols=len(poses))
    return figure
