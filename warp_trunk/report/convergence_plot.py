"""How the estimated error fell while the simulation ran."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .style import FAINT, INK, PREDICTED, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from warp_trunk.results import Summary


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
