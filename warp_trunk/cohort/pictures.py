"""The pictures of a cohort's page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.measures.comparison import DETECTABLE
from warp_trunk.report.style import ACTUAL, BEFORE, INK, PREDICTED, new_figure

from .errors_of import level_errors
from .record import CaseRow
from .summary import AGAINST, WHOLE, CohortSummary, case_errors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SPLINE = "#009e73"
"""Colour of the spline's guess; apart from the others for every kind of colour vision."""
PALE = 0.35


def cohort_pictures(rows: Sequence[CaseRow], summary: CohortSummary) -> dict[str, Figure]:
    """The figures by name; those for which nothing is known are left out."""
    counted = [row for row in rows if row.counts]
    figures = {}
    if summary.levels:
        figures |= {"levels": levels_picture(summary), "agreement": agreement_picture(counted, summary)}
    if summary.hump is not None:
        figures["hump"] = hump_picture(counted)
    known = [name for name in AGAINST if summary.trends[name] is not None]
    if known:
        figures["trends"] = trends_picture(counted, summary, known)
    return figures


def levels_picture(summary: CohortSummary) -> Figure:
    """Mean absolute error and its standard deviation at every level, with what any method must beat."""
    levels = list(summary.levels)
    figure = new_figure(6.4, 1.6 + 0.22 * max(len(levels), 8), "constrained")
    axes = figure.subplots()
    at = np.arange(len(levels))
    guesses: Mapping[str, tuple[Sequence[float], str, str, str]] = {
        "nothing changes": ([one.nothing_changes for one in summary.levels.values()], BEFORE.colour, "o", "--"),
        "the spline carries the skin": ([one.spline for one in summary.levels.values()], SPLINE, "D", ":"),
    }
    for label, (values, colour, marker, line) in guesses.items():
        axes.plot(
            values, at, color=colour, marker=marker, linestyle=line, markersize=4.0, linewidth=1.2, label=label
        )
    errors = [one.error for one in summary.levels.values()]
    axes.errorbar(
        [error.mean for error in errors],
        at,
        xerr=[error.sd or 0.0 for error in errors],
        color=PREDICTED.colour,
        marker=PREDICTED.marker,
        markersize=5.0,
        linewidth=1.4,
        elinewidth=1.0,
        capsize=3.0,
        label="predicted (mean ± SD over patients)",
    )
    axes.axvline(DETECTABLE, color=INK, linewidth=0.8, linestyle=(0, (6, 3)))
    axes.set_yticks(at, levels)
    axes.set_ylim(len(levels) - 0.4, -0.6)
    axes.set_xlim(left=0.0)
    axes.grid()
    axes.set_xlabel(f"mean absolute error of back surface rotation [degrees]; dashed: {DETECTABLE:g}")
    axes.set_ylabel("vertebra")
    figure.legend(loc="outside upper center", ncols=2)
    return figure


def agreement_picture(rows: Sequence[CaseRow], summary: CohortSummary) -> Figure:
    """Bland and Altman's plot: every level's difference over its mean, with the limits of agreement."""
    ones = level_errors(rows, WHOLE)
    figure = new_figure(4.6, 4.6, "constrained")
    axes = figure.subplots()
    guessed, actual = np.array([(one.guessed, one.actual) for one in ones]).T
    lumbar = np.array([one.level.startswith("L") for one in ones])
    for part, marker, colour, label in (
        (~lumbar, "s", PREDICTED.colour, "thoracic"),
        (lumbar, "^", ACTUAL.colour, "lumbar"),
    ):
        axes.plot(
            (0.5 * (guessed + actual))[part],
            (guessed - actual)[part],
            marker,
            color=colour,
            markersize=3.5,
            alpha=PALE + 0.2,
            markeredgewidth=0.0,
            label=label,
        )
    found = summary.agreement
    if found is not None:
        for value, name, style in (
            (found.bias, "mean", "-"),
            (found.low, "", "--"),
            (found.high, "95 % limits", "--"),
        ):
            if value is not None:
                axes.axhline(value, color=INK, linewidth=0.9, linestyle=style)
                axes.annotate(f"{name} {value:+z.1f}".strip(), (1.0, value), xycoords=("axes fraction", "data"),
                              ha="right", va="bottom", fontsize=8.0)  # fmt: skip
    axes.grid()
    axes.set_xlabel("mean of predicted and actual back surface rotation [degrees]")
    axes.set_ylabel("predicted − actual [degrees]")
    figure.legend(loc="outside upper center", ncols=2)
    return figure


def hump_picture(rows: Sequence[CaseRow]) -> Figure:
    """The predicted hump of every case over the actual one, and where it was before."""
    figure = new_figure(4.6, 4.6, "constrained")
    axes = figure.subplots()
    humps = [(row.hump_actual_mm, row.hump_before_mm, row.hump_predicted_mm) for row in rows]
    actual, before, predicted = np.array(humps, dtype=np.float64).T  # None is NaN, and not drawn
    axes.axline((0.0, 0.0), slope=1.0, color=INK, linewidth=0.8)
    axes.plot(actual, before, BEFORE.marker, color=BEFORE.colour, fillstyle="none", label="before surgery")
    axes.plot(actual, predicted, PREDICTED.marker, color=PREDICTED.colour, label="predicted")
    axes.grid()
    axes.set_aspect("equal", "datalim")
    axes.set_xlabel("actual largest hump [mm], positive on the right")
    axes.set_ylabel("guessed largest hump [mm]")
    figure.legend(loc="outside upper center", ncols=2)
    return figure


def trends_picture(rows: Sequence[CaseRow], summary: CohortSummary, known: Sequence[str]) -> Figure:
    """The error of every case over what it may go with, with the line of least squares."""
    figure = new_figure(3.1 * len(AGAINST), 3.0, "constrained")
    panels: list[Axes] = figure.subplots(1, len(AGAINST), sharey=True).tolist()
    errors = case_errors(rows)
    for axes, name in zip(panels, known, strict=False):
        values = [getattr(row, name) for row in rows]
        pairs = np.array([(x, y) for x, y in zip(values, errors, strict=True) if None not in (x, y)], dtype=float)
        axes.plot(*pairs.T, PREDICTED.marker, color=PREDICTED.colour, markersize=4.5)
        line = summary.trends[name]
        if line is not None:
            ends = np.array([pairs[:, 0].min(), pairs[:, 0].max()])
            axes.plot(ends, line.intercept + line.slope * ends, color=INK, linewidth=1.0)
            axes.set_title(f"r = {line.correlation:+z.2f}, p = {line.p:.2f}", fontsize=9.0)
        axes.axhline(DETECTABLE, color=INK, linewidth=0.8, linestyle=(0, (6, 3)))
        axes.grid()
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel(AGAINST[name])
        axes.ticklabel_format(axis="x", style="plain", useOffset=False)
        axes.locator_params(axis="x", nbins=4)
    for axes in panels[len(known) :]:
        axes.set_axis_off()
    panels[0].set_ylabel("mean absolute error [degrees]")
    return figure
