"""The files of a cohort, its page, which needs nothing else and reaches for nothing, and its text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from warp_trunk.geometry.surface import short_digest
from warp_trunk.io.atomic_write import csv_text, json_text, write_whole
from warp_trunk.measures.comparison import RANGES
from warp_trunk.measures.quantities import DETECTABLE
from warp_trunk.report.page import rendered, sheet_line
from warp_trunk.report.style import ACTUAL, BEFORE, INK, PREDICTED, RC, file_of, new_figure

from .one_case import FAILED, CaseRow
from .statistics import PatientMean
from .summary import AGAINST, WHOLE, CohortSummary, case_errors, errors, summarize_cohort, tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def cohort_page(rows: Sequence[CaseRow], summary: CohortSummary, sheet: str) -> str:
    """The text of the page, with a line for the foot of its sheets; all that comes from files is escaped."""
    from matplotlib import rc_context  # heavy

    with rc_context(RC):
        drawn = (levels_picture(summary), agreement_picture(rows, summary)) if summary.levels else ()
        drawings = {n: file_of(figure, "svg") for n, figure in zip(("levels", "agreement"), drawn, strict=False)}
    per_case = case_errors(errors(rows)).filter(guess="predicted").select("folder", "range", "mean", "sd")
    return rendered(
        "cohort.html",
        drawings,
        sheet=sheet,
        summary=summary,
        rows=[row for row in rows if row.status != FAILED],
        errors={(folder, part): error for folder, part, *error in per_case.iter_rows()},
        warnings=[*worse_parts(summary), *_left_out(rows, summary)],
        distances=distances_text(summary),
        against=AGAINST,
        detectable=DETECTABLE,
    )


def _left_out(rows: Sequence[CaseRow], summary: CohortSummary) -> list[str]:
    """The cases that do not count, with the reason."""
    return [
        *(f"{row.folder} has no result: {row.reason}" for row in rows if row.status == FAILED),
        *(f"{name} did not converge and does not count." for name in summary.unfinished),
        *(f"{name} has no actual skin to be judged by." for name in summary.without_actual),
    ]


def plus_minus(estimate: PatientMean) -> str:
    """A mean with its standard deviation, if it has one."""
    return f"{estimate.mean:.2f}" + ("" if estimate.sd is None else f" ± {estimate.sd:.2f}")


SPLINE = "#009e73"
"""Colour of the spline's guess; apart from the others for every kind of colour vision."""
PALE = 0.55


def levels_picture(summary: CohortSummary) -> Figure:
    """Mean absolute error and its standard deviation at every level, with the errors that any method must beat."""
    levels = summary.levels
    figure = new_figure(6.4, 1.6 + 0.22 * max(len(levels), 8), "constrained")
    axes, places = figure.subplots(), np.arange(len(levels))
    nothing, spline = [at.nothing_changes for at in levels.values()], [at.spline for at in levels.values()]
    small: dict[str, Any] = {"markersize": 4.0, "linewidth": 1.2}
    axes.plot(nothing, places, "o--", color=BEFORE.colour, label="nothing changes", **small)
    axes.plot(spline, places, "D:", color=SPLINE, label="the spline carries the skin", **small)
    errors = [at.error for at in levels.values()]
    axes.errorbar(
        [error.mean for error in errors],
        places,
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
    axes.set_yticks(places, list(levels))
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
    table = errors(row for row in rows if row.counts)
    table = table.filter(pl.col("level").is_in(RANGES[WHOLE]), guess="predicted")
    table = table.with_columns(lumbar=pl.col("level").str.starts_with("L"))
    figure = new_figure(4.6, 4.6, "constrained")
    axes = figure.subplots()
    guessed, actual, lumbar = (table[name].to_numpy() for name in ("guessed", "actual", "lumbar"))
    pale: dict[str, Any] = {"markersize": 3.5, "alpha": PALE, "markeredgewidth": 0.0}
    for part, marker, colour, label in (
        (~lumbar, "s", PREDICTED.colour, "thoracic"),
        (lumbar, "^", ACTUAL.colour, "lumbar"),
    ):
        mean, difference = 0.5 * (guessed + actual)[part], (guessed - actual)[part]
        axes.plot(mean, difference, marker, color=colour, label=label, **pale)
    if (limits := summary.agreement) is not None:
        for value, name, style in (
            (limits.bias, "mean", "-"),
            (limits.low, "", "--"),
            (limits.high, "95 % limits", "--"),
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
        mean_of = summary.ranges[name]
        for what, gain, other in (
            ("saying that nothing changes", mean_of.better_than_nothing, mean_of.nothing_changes),
            ("moving the skin with the spline of the landmarks", mean_of.better_than_spline, mean_of.spline),
        ):
            error = mean_of.error
            if gain is not None and other is not None and error is not None and gain.mean < 0.0:
                sentences.append(
                    f"{part} is predicted worse than by {what}: the error is {error.mean:.2f} degrees, not "
                    f"{other.mean:.2f}; the difference is {-gain.mean:.2f}{_interval_of_loss(gain)}."
                )
    return sentences


def _interval_of_loss(gain: PatientMean) -> str:
    """How sure a loss is."""
    if gain.low is None or gain.high is None:
        return "; fewer than three patients do not show whether that holds for others"
    sure = "" if gain.high < 0.0 else "; it holds 0, so these patients do not show it"
    return f" (95 % interval {-gain.high:.2f} to {-gain.low:.2f}{sure})"


TABLE, CASES, RECORD, PAGE = "cohort.csv", "cases.csv", "cohort.json", "cohort.html"
_CASE = tuple(field.name for field in fields(CaseRow) if field.name != "measures")


def write_cohort(out: Path, rows: Sequence[CaseRow]) -> CohortSummary:
    """Writes the tables and the page of a cohort into a folder; an earlier one is replaced, the page last.

    `cases.csv` has a row for each case, `cohort.csv` one for each measured number of each. Printed sheets name the
    folder, the day and a fingerprint of the numbers.
    """
    summary = summarize_cohort(rows)
    write_whole(out / CASES, csv_text([_CASE, *([getattr(row, name) for name in _CASE] for row in rows)]))
    numbers = tidy(rows).write_csv()
    sheet = sheet_line(out.resolve().name, date.today().isoformat(), short_digest(numbers))
    write_whole(out / TABLE, numbers)
    write_whole(out / RECORD, json_text({"summary": summary, "cases": rows}))
    write_whole(out / PAGE, cohort_page(rows, summary, sheet))
    return summary


def cohort_text(summary: CohortSummary) -> str:
    """The text of a cohort for the terminal."""
    synthetic = f"; {summary.synthetic} are synthetic" if summary.synthetic else ""
    count = f"of which {summary.counted} count, from {summary.patients} patients"
    lines = [f"{summary.cases} cases, {count}{synthetic}"]
    for what, names in (
        ("failed", summary.failed),
        ("did not converge", summary.unfinished),
        ("without an actual skin", summary.without_actual),
        ("bending, not surgery", summary.bending),
    ):
        if names:
            more = f" and {len(names) - 12} more" if len(names) > 12 else ""
            lines.append(f"{what}: {', '.join(names[:12])}{more}")
    for name, estimates in summary.ranges.items():
        error, nothing, spline = estimates.error, estimates.nothing_changes, estimates.spline
        if error and nothing and spline and (within := estimates.within):
            lines.append(
                f"{name:<7} mean absolute error {plus_minus(error)}° over patients; "
                f"{nothing.mean:.2f}° if nothing changed, {spline.mean:.2f}° by the spline; "
                f"{100.0 * within.mean:.0f} % of levels within {DETECTABLE:g}°"
            )
    return "\n".join([*lines, *distances_text(summary), *worse_parts(summary)])
