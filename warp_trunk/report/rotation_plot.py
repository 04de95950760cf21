"""Back surface rotation by vertebral level, as Fig. 4.7 of [2]."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from .style import INK, PREDICTED, Pose, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from warp_trunk.results.bands import Band


def rotation_plot(poses: Sequence[Pose], bands: Mapping[str, Band] | None = None) -> Figure:
    """The angle of every pose at every level, top to bottom; a level that was not measured leaves a gap.

    Where it is known how sure the prediction is, whiskers reach as far as it lies in 19 of 20 cases.
    """
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
    for level, band in (bands or {}).items():
        if level in levels:
            axes.plot([band.low, band.high], [levels.index(level)] * 2, "|-", color=PREDICTED.colour, alpha=0.5)
    axes.set_yticks(range(len(levels)), levels)
    axes.set_ylim(len(levels) - 0.4, -0.6)
    least, most = axes.get_xlim()
    axes.set_xlim(min(least, -2.0), max(most, 2.0))
    axes.grid()
    axes.set_xlabel("← left side further back      back surface rotation [degrees]      right side further back →")
    axes.set_ylabel("vertebra")
    figure.legend(loc="outside upper center", ncols=len(poses))
    return figure
