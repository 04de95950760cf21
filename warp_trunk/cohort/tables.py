"""The files of a cohort: cohort.csv, cases.csv, cohort.json and cohort.html."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

from warp_trunk.io.atomic_write import csv_text, json_text, write_whole
from warp_trunk.measures.quantities import DETECTABLE

from .cohort_page import cohort_page, distances_text, plus_minus, worse_parts
from .rows import CaseRow
from .summary import CohortSummary, summarize_cohort, tidy

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
