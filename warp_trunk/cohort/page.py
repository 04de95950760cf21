"""The page of a cohort: one HTML file, which needs nothing else and reaches for nothing."""

from __future__ import annotations

from collections.abc import Sequence

from warp_trunk.measures.comparison import DETECTABLE
from warp_trunk.report.page import rendered
from warp_trunk.report.style import RC, file_of

from .against_baselines import over_whole_back, worse_parts
from .errors_of import case_error
from .pictures import cohort_pictures
from .record import FAILED, CaseRow
from .statistics.estimate import Estimate
from .summary import CohortSummary

RANGE_HEAD = (
    "levels",
    "patients",
    "mean absolute error",
    "95 % interval",
    "if nothing changed",
    "by the spline",
    f"levels within {DETECTABLE:g}°",
    f"cases within {DETECTABLE:g}°",
    "levels in their band",
)
LEVEL_HEAD = (
    "level",
    "patients",
    "mean absolute error",
    "95 % interval",
    "bias",
    "if nothing changed",
    "by the spline",
)
CASE_HEAD = (
    "case",
    "T3-T12",
    "L1-L5",
    "T4-T12",
    "skin of the back",
    "hump: before",
    "predicted",
    "actual",
    "ended",
)
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
    said = []
    for name in ("T3-T12", "L1-L5"):
        one = summary.ranges[name]
        if one.error is not None:
            said.append((f"mean absolute error {name}", _plus_minus(one.error)))
    whole = summary.ranges["T3-L5"]
    if whole.within is not None:
        said.append((f"levels within {DETECTABLE:g} degrees", _percent(whole.within)))
    if whole.in_band is not None:
        said.append(("levels in their 95 % band", _percent(whole.in_band)))
    if summary.hump is not None:
        said.append(("mean absolute error of the hump", f"{summary.hump.error.mean:.1f} mm"))
    return said


def _range_rows(summary: CohortSummary) -> list[list[str]]:
    return [
        [
            WHAT[name],
            str(one.error.patients),
            _plus_minus(one.error),
            _interval(one.error),
            _plus_minus(one.nothing_changes),
            _plus_minus(one.spline),
            _percent(one.within),
            _percent(one.cases_within),
            _percent(one.in_band),
        ]
        for name in WHAT
        if (one := summary.ranges[name]).error is not None
    ]


def _level_rows(summary: CohortSummary) -> list[list[str]]:
    return [
        [
            level,
            str(one.error.patients),
            _plus_minus(one.error),
            _interval(one.error),
            f"{one.bias:+z.2f}",
            f"{one.nothing_changes:.2f}",
            f"{one.spline:.2f}",
        ]
        for level, one in summary.levels.items()
    ]


def _case_row(row: CaseRow) -> list[str]:
    errors = [case_error(row, of) for of in ("T3-T12", "L1-L5", "T4-T12")]
    return [
        f"{row.folder}: {row.case}" if row.case and row.case != row.folder else row.folder,
        *(_NONE if e is None else f"{e.mean:.2f}" + ("" if e.sd is None else f" ± {e.sd:.2f}") for e in errors),
        _number(row.skin_distance_mm, " mm"),
        *(_number(value) for value in (row.hump_before_mm, row.hump_predicted_mm, row.hump_actual_mm)),
        row.status + (", bending" if row.pose == "bending" else ""),
    ]


def _left_out(rows: Sequence[CaseRow], summary: CohortSummary) -> list[str]:
    """The cases that do not count, with the reason."""
    said = [f"{row.folder} has no result: {row.reason}" for row in rows if row.status == FAILED]
    said += [f"{name} did not converge and does not count." for name in summary.unfinished]
    said += [f"{name} has no actual skin to be judged by." for name in summary.without_actual]
    return said


def _hump(summary: CohortSummary) -> str:
    """The hump in a sentence; empty where none is known."""
    if summary.hump is None:
        return ""
    found, line = summary.hump.agreement, summary.hump.line
    text = f"Mean absolute error {_plus_minus(summary.hump.error)} mm; predicted less actual {found.bias:+z.1f} mm"
    if found.low is not None and found.high is not None:
        text += f", 95 % of cases from {found.low:+z.1f} to {found.high:+z.1f} mm"
    if line is not None:
        text += f"; correlation {line.correlation:.2f}, slope {line.slope:.2f}"
    return text + "."


def _plus_minus(one: Estimate | None) -> str:
    if one is None:
        return _NONE
    return f"{one.mean:.2f}" + ("" if one.sd is None else f" ± {one.sd:.2f}")


def _interval(one: Estimate) -> str:
    return _NONE if one.low is None or one.high is None else f"{one.low:.2f} to {one.high:.2f}"


def _percent(one: Estimate | None) -> str:
    return _NONE if one is None else f"{100.0 * one.mean:.0f} %"


def _number(value: float | None, unit: str = "") -> str:
    return _NONE if value is None else f"{value:.1f}{unit}"
