"""The page of a cohort: one HTML file, which needs nothing else and reaches for nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from warp_trunk.measures.comparison import DETECTABLE, BsrError
from warp_trunk.report.page import rendered
from warp_trunk.report.style import ACTUAL, BEFORE, INK, PREDICTED, RC, file_of, new_figure

from .rows import FAILED, CaseRow, case_error, level_errors
from .statistics import Estimate
from .summary import AGAINST, WHOLE, CohortSummary, RangeSummary, case_errors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_ERROR = ("patients", "mean absolute error", "95 % interval")
_BASELINES = ("if nothing changed", "by the spline")
_PARTS = ("T3-T12", "L1-L5", "T4-T12")
_SHARES = (f"levels within {DETECTABLE:g}°", f"cases within {DETECTABLE:g}°", "levels in their band")
RANGE_HEAD = ("levels", *_ERROR, *_BASELINES, *_SHARES)
LEVEL_HEAD = ("level", *_ERROR, "bias", *_BASELINES)
CASE_HEAD = ("case", *_PARTS, "skin of the back", "hump: before", "predicted", "actual", "ended")
_NONE = "–"
WHAT = {
    "T3-L5": "T3-L5, whole spine [1]",
    "T3-T12": "T3-T12, thoracic [1]",
    "L1-L5": "L1-L5, lumbar [1]",
    "T4-T12": "T4-T12, thoracic [2]",
}


def cohort_page(rows: Sequence[CaseRow], summary: CohortSummary) -> str:
    """The text of the page; all that comes from files is escaped."""
    from matplotlib import rc_context  # heavy

    with rc_context(RC):
        drawings = {name: file_of(figure, "svg") for name, figure in cohort_pictures(rows, summary).items()}
    return rendered(
        "cohort.html",
        drawings,
        virtual=summary.virtual > 0,
        cases=summary.cases,
        counted=summary.counted,
        patients=summary.patients,
        made_up_cases=summary.virtual,
        first=[*worse_parts(summary), *_left_out(rows, summary)],
        glance=_glance(summary),
        detectable=DETECTABLE,
        range_head=RANGE_HEAD,
        range_rows=_range_rows(summary),
        better=over_whole_back(summary),
        level_head=LEVEL_HEAD,
        level_rows=_level_rows(summary),
        hump=_hump(summary),
        case_head=CASE_HEAD,
        case_rows=[_case_row(row) for row in rows if row.status != FAILED],
    )


def _glance(summary: CohortSummary) -> list[tuple[str, str]]:
    """The numbers that a reader looks for first."""
    whole, hump = summary.ranges["T3-L5"], summary.hump
    errors = {name: summary.ranges[name].error for name in ("T3-T12", "L1-L5")}
    rows = [(f"mean absolute error {name}", plus_minus(error)) for name, error in errors.items()]
    rows.append((f"levels within {DETECTABLE:g} degrees", _percent(whole.within)))
    rows.append(("levels in their 95 % band", _percent(whole.in_band)))
    rows.append(("mean absolute error of the hump", _number(hump and hump.error.mean, " mm")))
    return [(name, value) for name, value in rows if value != _NONE]


def _range_rows(summary: CohortSummary) -> list[list[str]]:
    return [
        [WHAT[name], *_error_cells(one.error), plus_minus(one.nothing_changes), plus_minus(one.spline)]
        + [_percent(share) for share in (one.within, one.cases_within, one.in_band)]
        for name in WHAT
        if (one := summary.ranges[name]).error is not None
    ]


def _level_rows(summary: CohortSummary) -> list[list[str]]:
    return [
        [level, *_error_cells(one.error), f"{one.bias:+z.2f}", f"{one.nothing_changes:.2f}", f"{one.spline:.2f}"]
        for level, one in summary.levels.items()
    ]


def _case_row(row: CaseRow) -> list[str]:
    return [
        f"{row.folder}: {row.case}" if row.case and row.case != row.folder else row.folder,
        *(plus_minus(case_error(row, of)) for of in _PARTS),
        _number(row.skin_distance_mm, " mm"),
        *(_number(value) for value in (row.hump_before_mm, row.hump_predicted_mm, row.hump_actual_mm)),
        row.status + (", bending" if row.pose == "bending" else ""),
    ]


def _left_out(rows: Sequence[CaseRow], summary: CohortSummary) -> list[str]:
    """The cases that do not count, with the reason."""
    return [
        *(f"{row.folder} has no result: {row.reason}" for row in rows if row.status == FAILED),
        *(f"{name} did not converge and does not count." for name in summary.unfinished),
        *(f"{name} has no actual skin to be judged by." for name in summary.without_actual),
    ]


def _hump(summary: CohortSummary) -> str:
    """The hump in a sentence; empty where none is known."""
    if summary.hump is None:
        return ""
    found, line = summary.hump.agreement, summary.hump.line
    text = f"Mean absolute error {plus_minus(summary.hump.error)} mm; predicted less actual {found.bias:+z.1f} mm"
    if found.low is not None and found.high is not None:
        text += f", 95 % of cases from {found.low:+z.1f} to {found.high:+z.1f} mm"
    if line is not None:
        text += f"; correlation {line.correlation:.2f}, slope {line.slope:.2f}"
    return text + "."


def plus_minus(one: Estimate | BsrError | None) -> str:
    """A mean with its standard deviation, if it has one."""
    if one is None:
        return _NONE
    return f"{one.mean:.2f}" + ("" if one.sd is None else f" ± {one.sd:.2f}")


def _error_cells(one: Estimate | None) -> list[str]:
    """The cells under `_ERROR`."""
    if one is None:
        return [_NONE] * 3
    interval = _NONE if one.low is None or one.high is None else f"{one.low:.2f} to {one.high:.2f}"
    return [str(one.patients), plus_minus(one), interval]


def _percent(one: Estimate | None) -> str:
    return _NONE if one is None else f"{100.0 * one.mean:.0f} %"


def _number(value: float | None, unit: str = "") -> str:
    return _NONE if value is None else f"{value:.1f}{unit}"


SPLINE = "#009e73"
"""Colour of the spline's guess; apart from the others for every kind of colour vision."""
PALE = 0.55


def cohort_pictures(rows: Sequence[CaseRow], summary: CohortSummary) -> dict[str, Figure]:
    """The figures by name; those for which nothing is known are left out."""
    counted = [row for row in rows if row.counts]
    figures = {}
    if summary.levels:
        figures |= {"levels": levels_picture(summary), "agreement": agreement_picture(counted, summary)}
    if summary.hump is not None:
        figures["hump"] = hump_picture(counted)
    if any(summary.trends.values()):
        figures["trends"] = trends_picture(counted, summary)
    return figures


def levels_picture(summary: CohortSummary) -> Figure:
    """Mean absolute error and its standard deviation at every level, with the errors that any method must beat."""
    levels = summary.levels
    figure = new_figure(6.4, 1.6 + 0.22 * max(len(levels), 8), "constrained")
    axes, at = figure.subplots(), np.arange(len(levels))
    nothing, spline = [one.nothing_changes for one in levels.values()], [one.spline for one in levels.values()]
    small: dict[str, Any] = {"markersize": 4.0, "linewidth": 1.2}
    axes.plot(nothing, at, "o--", color=BEFORE.colour, label="nothing changes", **small)
    axes.plot(spline, at, "D:", color=SPLINE, label="the spline carries the skin", **small)
    errors = [one.error for one in levels.values()]
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
    axes.set_yticks(at, list(levels))
    axes.set_ylim(len(levels) - 0.4, -0.6)
    axes.set_xlim(left=0.0)
    across = f"mean absolute error of back surface rotation [degrees]; dashed: {DETECTABLE:g}"
    _finish(figure, axes, across, "vertebra")
    return figure


def _finish(figure: Figure, axes: Axes, across: str, up: str) -> None:
    """Labels and a grid for the only axes of a figure, and its legend above."""
    axes.grid()
    axes.set_xlabel(across)
    axes.set_ylabel(up)
    figure.legend(loc="outside upper center", ncols=2)


def agreement_picture(rows: Sequence[CaseRow], summary: CohortSummary) -> Figure:
    """Bland and Altman's plot: every level's difference over its mean, with the limits of agreement."""
    ones = level_errors(rows, WHOLE)
    figure = new_figure(4.6, 4.6, "constrained")
    axes = figure.subplots()
    guessed, actual = np.array([(one.guessed, one.actual) for one in ones]).T
    lumbar = np.array([one.level.startswith("L") for one in ones])
    pale: dict[str, Any] = {"markersize": 3.5, "alpha": PALE, "markeredgewidth": 0.0}
    for part, marker, colour, label in (
        (~lumbar, "s", PREDICTED.colour, "thoracic"),
        (lumbar, "^", ACTUAL.colour, "lumbar"),
    ):
        mean, difference = 0.5 * (guessed + actual)[part], (guessed - actual)[part]
        axes.plot(mean, difference, marker, color=colour, label=label, **pale)
    if (found := summary.agreement) is not None:
        for value, name, style in (
            (found.bias, "mean", "-"),
            (found.low, "", "--"),
            (found.high, "95 % limits", "--"),
        ):
            if value is not None:
                text, place = f"{name} {value:+z.1f}".strip(), ("axes fraction", "data")
                axes.axhline(value, color=INK, linewidth=0.9, linestyle=style)
                axes.annotate(text, (1.0, value), xycoords=place, ha="right", va="bottom", fontsize=8.0)
    across = "mean of predicted and actual back surface rotation [degrees]"
    _finish(figure, axes, across, "predicted − actual [degrees]")
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
    axes.set_aspect("equal", "datalim")
    _finish(figure, axes, "actual largest hump [mm], positive on the right", "guessed largest hump [mm]")
    return figure


def trends_picture(rows: Sequence[CaseRow], summary: CohortSummary) -> Figure:
    """The error of every case over what it may go with, with the line of least squares."""
    known = {name: line for name, line in summary.trends.items() if line is not None}
    figure = new_figure(3.1 * len(AGAINST), 3.0, "constrained")
    panels: list[Axes] = figure.subplots(1, len(AGAINST), sharey=True).tolist()
    for axes, (name, line) in zip(panels, known.items(), strict=False):
        pairs = zip([getattr(row, name) for row in rows], case_errors(rows), strict=True)
        x, y = np.array([pair for pair in pairs if None not in pair], dtype=float).T
        axes.plot(x, y, PREDICTED.marker, color=PREDICTED.colour, markersize=4.5)
        ends = np.array([x.min(), x.max()])
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


REGIONS = {"T3-T12": "The thoracic back (T3-T12)", "L1-L5": "The lumbar back (L1-L5)"}
"""Regions that together are the whole back that is judged."""


def over_whole_back(summary: CohortSummary) -> list[str]:
    """A sentence for each baseline, over all levels from T3 to L5."""
    return [
        f"The error is {abs(gain.mean):.2f} degrees {'smaller' if gain.mean > 0.0 else 'larger'} than by {what}"
        f"{_interval_of_gain(gain)}."
        for what, gain, _ in _baselines(summary.ranges["T3-L5"])
    ]


def worse_parts(summary: CohortSummary) -> list[str]:
    """A sentence for each region that is predicted worse than by a baseline."""
    return [
        f"{part} is predicted worse than by {what}: the error is {error.mean:.2f} degrees, not {other.mean:.2f}; "
        f"the difference is {-gain.mean:.2f}{_interval_of_gain(gain, -1.0)}."
        for name, part in REGIONS.items()
        for what, gain, other in _baselines(summary.ranges[name])
        if gain.mean < 0.0 and (error := summary.ranges[name].error) is not None
    ]


def _baselines(found: RangeSummary) -> list[tuple[str, Estimate, Estimate]]:
    """Each baseline with what is gained over it and its own error, as far as they are known."""
    both = (
        ("saying that nothing changes", found.better_than_nothing, found.nothing_changes),
        ("moving the skin with the spline of the landmarks", found.better_than_spline, found.spline),
    )
    return [(what, gain, other) for what, gain, other in both if gain is not None and other is not None]


def _interval_of_gain(gain: Estimate, way: float = 1.0) -> str:
    """How sure a gain is, or a loss where `way` is -1."""
    if gain.low is None or gain.high is None:
        return "; fewer than three patients do not show whether that holds for others"
    low, high = sorted((way * gain.low, way * gain.high))
    sure = "" if low > 0.0 or high < 0.0 else "; it holds 0, so these patients do not show it"
    return f" (95 % interval {low:.2f} to {high:.2f}{sure})"
