"""The files of a cohort: cohort.csv, cohort.json and cohort.html."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec

from warp_trunk.io.atomic_write import csv_text, write_whole
from warp_trunk.measures.comparison import DETECTABLE

from .page import cohort_page, plus_minus, worse_parts
from .rows import CaseRow, LevelRow
from .summary import CohortSummary, summarize_cohort

TABLE, RECORD, PAGE = "cohort.csv", "cohort.json", "cohort.html"
_LEVEL = tuple(field.name for field in dataclasses.fields(LevelRow))
_CASE = tuple(field.name for field in dataclasses.fields(CaseRow) if field.name != "levels")
COLUMNS = (*_CASE, *(name if name in ("level", "in_band") else f"bsr_{name}_deg" for name in _LEVEL))
"""Header of cohort.csv."""


def write_cohort(out: Path, rows: Sequence[CaseRow]) -> CohortSummary:
    """Writes the tables and the page of a cohort into a folder; an earlier one is replaced, the page last."""
    summary = summarize_cohort(rows)
    write_whole(out / TABLE, csv_text([COLUMNS, *table_rows(rows)]))
    record = msgspec.json.encode({"summary": summary, "cases": rows})
    write_whole(out / RECORD, msgspec.json.format(record, indent=2) + b"\n")
    write_whole(out / PAGE, cohort_page(rows, summary))
    return summary


def table_rows(rows: Sequence[CaseRow]) -> Iterator[list[Any]]:
    """The rows of cohort.csv: one for each case and level; a case without levels has one row."""
    for row in rows:
        case = [getattr(row, name) for name in _CASE]
        for level in row.levels or (LevelRow(level=""),):
            yield [*case, *(getattr(level, name) for name in _LEVEL)]


def cohort_text(summary: CohortSummary) -> str:
    """The text of a cohort for the terminal."""
    synthetic = f"; {summary.virtual} are synthetic" if summary.virtual else ""
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
        if one.error is not None and one.nothing_changes and one.spline and one.within:
            lines.append(
                f"{name:<7} mean absolute error {plus_minus(one.error)}° over patients; "
                f"{one.nothing_changes.mean:.2f}° if nothing changed, {one.spline.mean:.2f}° by the spline; "
                f"{100.0 * one.within.mean:.0f} % of levels within {DETECTABLE:g}°"
            )
    return "\n".join([*lines, *worse_parts(summary)])
