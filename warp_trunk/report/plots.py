"""Plots: rotation of the back, horizontal sections, and how the estimated error fell."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.engine.relaxation import ON_THE_WAY
from warp_trunk.measures.levels import JUDGED
from warp_trunk.measures.measures import seen_points
from warp_trunk.measures.number_text import sided
from warp_trunk.measures.quantities import QUANTITIES
from warp_trunk.measures.verdicts import NOT_KNOWN, is_known
from warp_trunk.results import Summary
from warp_trunk.spine.spine import spine_of
from warp_trunk.views.relief import in_pelvis

from .style import FAINT, INK, PREDICTED, TrunkState, new_figure


def rotation_plot(poses: Sequence[TrunkState], *, bands: bool = True) -> Figure:
    """The angle of every state at every level, top to bottom; a level that was not measured leaves a gap, and the
    rest of T1 and T2 beyond the others is cut off.

    Args:
        poses: the states, before surgery first.
        bands: whether whiskers reach as far as a number lies in 19 of 20 cases, where that is known.
    """
    levels = list(poses[0].column("bsr_deg"))
    figure = new_figure(6.4, 1.4 + 0.2 * max(len(levels), 8), "constrained")
    axes = figure.subplots()
    axes.axvline(0.0, color=INK, linewidth=0.8)
    for pose in poses:
        look, column = pose.look, pose.column("bsr_deg")
        rows = [column.get(level) for level in levels]
        axes.plot(
            [float("nan") if row is None or row.value is None else row.value for row in rows],
            range(len(levels)),
            color=look.colour,
            marker=look.marker,
            linestyle=look.line,
            markersize=5.0,
            linewidth=1.3,
            label=look.title,
        )
        for place, row in enumerate(rows):
            if bands and row is not None and row.low is not None and row.high is not None:
                axes.plot([row.low, row.high], [place] * 2, "|-", color=look.colour, alpha=0.5)
    axes.set_yticks(range(len(levels)), levels)
    axes.set_ylim(len(levels) - 0.4, -0.6)
    least, most = _extent(poses, bands=bands)
    axes.set_xlim(least, most)
    axes.grid()
    axes.set_xlabel("← left side further back      back surface rotation [degrees]      right side further back →")
    axes.set_ylabel("vertebra")
    figure.legend(loc="outside upper center", ncols=len(poses))
    return figure


def _extent(poses: Sequence[TrunkState], *, bands: bool) -> tuple[float, float]:
    """Ends of the axis that hold every rotation of the levels that are judged, T3 to L5 [degrees]."""
    rows = [row for pose in poses for level, row in pose.column("bsr_deg").items() if level in JUDGED]
    ends = [end for row in rows for end in ((row.low, row.value, row.high) if bands else (row.value,))]
    values = [-2.0, 2.0, *(end for end in ends if end is not None)]
    spare = 0.05 * (max(values) - min(values))
    return min(values) - spare, max(values) + spare


def convergence_plot(summary: Summary) -> Figure:
    """The estimated error after every step against time, both from the summary of a result."""
    figure = new_figure(6.4, 2.9, "constrained")
    axes = figure.subplots()
    axes.set_yscale("log")
    start, points = 0.0, []
    for row in summary.increments:
        steps = row.history or [row]  # without a history, its end
        errors = [(start + s.seconds, s.estimated_error_mm) for s in steps if s.estimated_error_mm]
        if errors:
            points += errors
            axes.plot(*zip(*errors, strict=True), color=PREDICTED.colour, marker=PREDICTED.marker, markersize=3.5)
        start += row.seconds
        axes.axvline(start, color="#dddddd", linewidth=0.6, zorder=0)
    tolerance = summary.parameters.get("tolerance") or 0.0
    limits = [(tolerance, "at the end", "top"), (ON_THE_WAY * tolerance, "before the\nlast increment", "bottom")]
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


COLUMNS, POINTS = 4, 60
"""Columns of sections, and how many points of an outline are drawn."""
TICK = np.array([3.5, 3.5])
"""Half of a line of the hatch on an outline that was not measured [mm]."""
SCALE = 100.0
"""Length of the bar in the first section [mm]."""


def section_plots(poses: Sequence[TrunkState]) -> Figure:
    """All poses over each other at every level, seen from above with the back below, in the pelvis' axes."""
    levels = list(poses[0].measures.tangents)
    outlines = [
        {at: tangent and tangent.outline for at, tangent in pose.measures.tangents.items()} for pose in poses
    ]
    seen = [
        {} if pose.unseen is None else seen_points(pose.skin, pose.unseen, outline, spine_of(pose.landmarks))
        for pose, outline in zip(poses, outlines, strict=True)
    ]
    rows = -(-len(levels) // COLUMNS)
    height = 1.42 * rows + 0.4
    figure = new_figure(7.6, height)  # a constrained layout of so many axes takes seconds
    edges = {"left": 0.01, "right": 0.99, "bottom": 0.08 / height, "top": 1.0 - 0.6 / height}
    grid = figure.subplots(
        max(rows, 1), COLUMNS, sharex=True, sharey=True, squeeze=False, gridspec_kw=edges | {"hspace": 0.25}
    )
    for axes in grid.flat:
        axes.set_axis_off()
    for axes, level in zip(grid.flat, levels, strict=False):
        for pose, of_scan in zip(poses, seen, strict=True):
            tangent = pose.measures.tangents.get(level)
            if tangent is None:
                continue
            if (scanned := of_scan.get(level)) is not None:
                invented = tangent.outline[~scanned]
                ends = _seen(invented[:: max(1, len(tangent.outline) // POINTS)], pose.landmarks)
                ticks = np.stack([ends - TICK, ends + TICK, np.full_like(ends, np.nan)], axis=1).reshape(-1, 2)
                axes.plot(*ticks.T, color=INK, linewidth=0.6, label="hatched: not measured")
            look = pose.look
            every = max(1, len(tangent.outline) // POINTS)
            outline = _seen(np.vstack([tangent.outline[::every], tangent.outline[:1]]), pose.landmarks)
            axes.plot(*outline.T, color=look.colour, linestyle=look.line, linewidth=0.8, label=look.title)
            contact = _seen(np.array([tangent.left, tangent.right]), pose.landmarks)
            axes.plot(
                *_seen(tangent.line, pose.landmarks).T, color=look.colour, linestyle=look.line, linewidth=1.3
            )
            axes.plot(*contact.T, color=look.colour, marker=look.marker, linestyle="", markersize=2.8)
        axes.set_title(level, loc="left", fontsize=9, fontweight="bold", pad=2)
        axes.set_title(_angles(poses, level), loc="right", fontsize=8, pad=2)
        if not axes.lines:
            axes.text(0.5, 0.4, "not measured", transform=axes.transAxes, ha="center", color=FAINT)
        axes.set_aspect("equal")
    if levels:
        grid[0, 0].invert_xaxis()
        grid[0, 0].invert_yaxis()
        for axes in grid.flat[: len(levels)]:
            for x, side in ((0.0, "left"), (1.0, "right")):
                axes.text(x, 0.0, side, transform=axes.transAxes, ha=side, fontsize=6.5, color=FAINT)
            axes.text(0.5, 0.0, "back", transform=axes.transAxes, ha="center", fontsize=6.5, color=FAINT)
        middle = sum(grid[0, 0].get_xlim()) / 2.0
        grid[0, 0].plot([middle - SCALE / 2.0, middle + SCALE / 2.0], [0.0, 0.0], color=INK, linewidth=1.4)
        grid[0, 0].text(middle, -6.0, f"{SCALE:g} mm", ha="center", va="bottom", fontsize=6.5, color=INK)
    handles = {h.get_label(): h for axes in grid.flat for h in axes.get_legend_handles_labels()[0]}
    figure.legend(handles=list(handles.values()), loc="upper center", ncols=max(len(handles), 1))
    return figure


def _seen(points: np.ndarray, landmarks: Landmarks) -> np.ndarray:
    """Points (n, 2) in the axes of the pelvis [mm]."""
    return in_pelvis(np.column_stack([points, np.zeros(len(points))]), landmarks)[:, :2]


def _angles(poses: Sequence[TrunkState], level: str) -> str:
    """The rotation at a level before and predicted, and the actual one in brackets."""
    rows = [pose.column("bsr_deg").get(level) for pose in poses]
    was = poses[0].number("bsr_deg", level)

    def text(number: int) -> str:
        row = rows[number]
        if row is None or row.value is None or number == 0 or is_known(QUANTITIES["bsr_deg"], row, was):
            return sided(None if row is None else row.value)
        return NOT_KNOWN

    before, predicted, *actual = map(text, range(len(rows)))
    return f"{before} → {predicted}" + "".join(f" ({angle})" for angle in actual)
