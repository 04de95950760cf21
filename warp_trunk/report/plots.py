"""The rotation of the back at every vertebra, and how the estimated error fell, as plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from .style import FAINT, INK, PREDICTED, Pose, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from warp_trunk.results import Summary
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


def convergence_plot(summary: Summary) -> Figure:
    """The estimated error after every step against time, both from the summary of a result."""
    figure = new_figure(6.4, 2.9, "constrained")
    axes = figure.subplots()
    axes.set_yscale("log")
    start, points = 0.0, []
    for row in summary.increments:
        steps = row.history or [row]  # without a history, its end
        known = [(start + s.seconds, s.estimated_error_mm) for s in steps if s.estimated_error_mm]
        if known:
            points += known
            axes.plot(*zip(*known, strict=True), color=PREDICTED.colour, marker=PREDICTED.marker, markersize=3.5)
        start += row.seconds
        axes.axvline(start, color="#dddddd", linewidth=0.6, zorder=0)
    tolerance = summary.parameters.get("tolerance") or 0.0
    limits = [(tolerance, "at the end", "top"), (10.0 * tolerance, "before the\nlast increment", "bottom")]
    for height, words, side in limits[: len(summary.increments)] if tolerance else []:
        axes.axhline(height, color=INK, linewidth=0.8, linestyle=":")
        axes.annotate(  # beside the axes, where no curve runs
            f"tolerance {words},\n{height:g} mm", (1.0, height), va=side, xycoords=("axes fraction", "data"),
            xytext=(4, 0), textcoords="offset points", fontsize=8, color=INK,
        )  # fmt: skip
    if points:
        axes.plot(*zip(*points, strict=True), color=PREDICTED.colour, linewidth=0.5, linestyle=":")
    else:
        axes.text(0.5, 0.5, "no error was estimated", transform=axes.transAxes, ha="center", color=FAINT)
    axes.set_xlim(0.0, 1.02 * max(start, 1e-3))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_xlabel("time [s]; a vertical line ends each increment of the correction")
    axes.set_ylabel("estimated error [mm]")
    axes.grid(axis="y")
    return figure
