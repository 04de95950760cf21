"""The files of a cohort, its page, which needs nothing else and reaches for nothing, and its text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from warp_trunk.io.atomic_write import csv_text, json_text, write_whole
from warp_trunk.measures.comparison import RANGES
from warp_trunk.measures.quantities import DETECTABLE, MeasureTable
from warp_trunk.report.page import rendered
from warp_trunk.report.style import ACTUAL, BEFORE, INK, PREDICTED, RC, file_of, new_figure

from .one_case import FAILED, CaseRow
from .statistics import Estimate
from .summary import AGAINST, WHOLE, CohortSummary, case_errors, errors, summarize_cohort, tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_ERROR = ("patients", "mean absolute error", "95 % interval")
_BASELINES = ("if nothing changed", "by the spline")
_PARTS = ("T3-T12", "L1-L5", "T4-T12")
_SHARES = (f"levels within {DETECTABLE:g}°", f"cases within {DETECTABLE:g}°", "levels in their band")
RANGE_HEAD = ("levels", *_ERROR, *_BASELINES, *_SHARES)
LEVEL_HEAD = ("level", *_ERROR, "bias", *_BASELINES)
TREND_HEAD = ("against", "cases", "slope", "correlation", "p")
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
        drawn = (levels_picture(summary), agreement_picture(rows, summary)) if summary.levels else ()
        drawings = {n: file_of(figure, "svg") for n, figure in zip(("levels", "agreement"), drawn, strict=False)}
    return rendered(
        "cohort.html",
        drawings,
        synthetic=summary.synthetic > 0,
        cases=summary.cases,
        counted=summary.counted,
        patients=summary.patients,
        made_up_cases=summary.synthetic,
        first=[*worse_parts(summary), *_left_out(rows, summary)],
        distances=distances_text(summary),
        detectable=DETECTABLE,
        range_head=RANGE_HEAD,
        range_rows=_range_rows(summary),
        level_head=LEVEL_HEAD,
        level_rows=_level_rows(summary),
        hump=_hump(summary),
        trend_head=TREND_HEAD,
        trend_rows=_trend_rows(summary),
        case_head=CASE_HEAD,
        case_rows=[_case_row(row) for row in rows if row.status != FAILED],
    )


def _range_rows(summary: CohortSummary) -> list[list[str]]:
    return [
        [WHAT[name], *_error_cells(one["error"]), plus_minus(one["nothing_changes"]), plus_minus(one["spline"])]
        + [_percent(one[share]) for share in ("within", "cases_within", "in_band")]
        for name in WHAT
        if (one := summary.ranges[name])["error"] is not None
    ]


def _level_rows(summary: CohortSummary) -> list[list[str]]:
    return [
        [level, *_error_cells(one.error), f"{one.bias:+z.2f}", f"{one.nothing_changes:.2f}", f"{one.spline:.2f}"]
        for level, one in summary.levels.items()
    ]


def _trend_rows(summary: CohortSummary) -> list[list[str]]:
    return [
        [AGAINST[name], str(line.points), f"{line.slope:+.2g}", f"{line.correlation:+z.2f}", f"{line.p:.2f}"]
        for name, line in summary.trends.items()
        if line is not None
    ]


def _case_row(row: CaseRow) -> list[str]:
    table = MeasureTable(row.measures)
    parts = {
        part: (mean, sd)
        for part, mean, sd in case_errors(errors([row]))
        .filter(guess="predicted")
        .select("range", "mean", "sd")
        .iter_rows()
    }
    return [
        f"{row.folder}: {row.case}" if row.case and row.case != row.folder else row.folder,
        *(_mean_sd(*parts.get(of, (None, None))) for of in _PARTS),
        _number(table.value("error", "distance_mean_mm", "back"), " mm"),
        *(_number(table.value(state, "max_hump_mm")) for state in ("before", "predicted", "actual")),
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


def plus_minus(one: Estimate | None) -> str:
    """A mean with its standard deviation, if it has one."""
    return _NONE if one is None else _mean_sd(one.mean, one.sd)


def _mean_sd(mean: float | None, sd: float | None) -> str:
    return _NONE if mean is None else f"{mean:.2f}" + ("" if sd is None else f" ± {sd:.2f}")


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
    ones = errors(row for row in rows if row.counts)
    ones = ones.filter(pl.col("level").is_in(RANGES[WHOLE]), guess="predicted")
    ones = ones.with_columns(lumbar=pl.col("level").str.starts_with("L"))
    figure = new_figure(4.6, 4.6, "constrained")
    axes = figure.subplots()
    guessed, actual, lumbar = (ones[name].to_numpy() for name in ("guessed", "actual", "lumbar"))
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


def distances_text(summary: CohortSummary) -> list[str]:
    """A sentence on cases without a spine; none where there is no such case."""
    error, nothing = summary.distance["error"], summary.distance["nothing_changes"]
    if error is None or nothing is None:
        return []
    return [
        f"Without a spine: mean distance from the actual skin {plus_minus(error)} mm over {error.patients} "
        f"patients; {nothing.mean:.2f} mm if nothing changed."
    ]


REGIONS = {"T3-T12": "The thoracic back (T3-T12)", "L1-L5": "The lumbar back (L1-L5)"}
"""Regions that together are the whole back that is judged."""


def worse_parts(summary: CohortSummary) -> list[str]:
    """A sentence for each region that is predicted worse than by a baseline."""
    sentences = []
    for name, part in REGIONS.items():
        found = summary.ranges[name]
        for what, gain, other in (
            ("saying that nothing changes", found["better_than_nothing"], found["nothing_changes"]),
            ("moving the skin with the spline of the landmarks", found["better_than_spline"], found["spline"]),
        ):
            error = found["error"]
            if gain is not None and other is not None and error is not None and gain.mean < 0.0:
                sentences.append(
                    f"{part} is predicted worse than by {what}: the error is {error.mean:.2f} degrees, not "
                    f"{other.mean:.2f}; the difference is {-gain.mean:.2f}{_interval_of_loss(gain)}."
                )
    return sentences


def _interval_of_loss(gain: Estimate) -> str:
    """How sure a loss is."""
    if gain.low is None or gain.high is None:
        return "; fewer than three patients do not show whether that holds for others"
    sure = "" if gain.high < 0.0 else "; it holds 0, so these patients do not show it"
    return f" (95 % interval {-gain.high:.2f} to {-gain.low:.2f}{sure})"


TABLE, CASES, RECORD, PAGE = "cohort.csv", "cases.csv", "cohort.json", "cohort.html"
_CASE = tuple(field.name for field in fields(CaseRow) if field.name != "measures")


def write_cohort(out: Path, rows: Sequence[CaseRow]) -> CohortSummary:
    """Writes the tables and the page of a cohort into a folder; an earlier one is replaced, the page last.

    `cases.csv` has a row for each case, `cohort.csv` one for each measured number of each.
    """
    summary = summarize_cohort(rows)
    write_whole(out / CASES, csv_text([_CASE, *([getattr(row, name) for name in _CASE] for row in rows)]))
    write_whole(out / TABLE, tidy(rows).write_csv())
    write_whole(out / RECORD, json_text({"summary": summary, "cases": rows}))
    write_whole(out / PAGE, cohort_page(rows, summary))
    return summary


def cohort_text(summary: CohortSummary) -> str:
    """The text of a cohort for the terminal."""
    synthetic = f"; {summary.synthetic} are synthetic" if summary.synthetic else ""
    lines = [f"{summary.cases} cases: {summary.counted} of {summary.patients} patients count{synthetic}"]
    for what, names in (
        ("failed", summary.failed),
        ("did not converge", summary.unfinished),
        ("without an actual skin", summary.without_actual),
        ("bending, not surgery", summary.bending),
    ):
        if names:
            more = f" and {len(names) - 12} more" if len(names) > 12 else ""
            lines.append(f"{what}: {', '.join(names[:12])}{more}")
    for name, one in summary.ranges.items():
        error, nothing, spline = one["error"], one["nothing_changes"], one["spline"]
        if error and nothing and spline and (within := one["within"]):
            lines.append(
                f"{name:<7} mean absolute error {plus_minus(error)}° over patients; "
                f"{nothing.mean:.2f}° if nothing changed, {spline.mean:.2f}° by the spline; "
                f"{100.0 * within.mean:.0f} % of levels within {DETECTABLE:g}°"
            )
    return "\n".join([*lines, *distances_text(summary), *worse_parts(summary)])
