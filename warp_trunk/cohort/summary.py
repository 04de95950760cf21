"""The summary of a whole cohort."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from warp_trunk.measures.comparison import DETECTABLE, RANGES

from .rows import CONVERGED, FAILED, CaseRow, Guess, case_error, level_errors
from .statistics import Estimate, LimitsOfAgreement, Trend, limits_of_agreement, over_patients, share_true, trend

WHOLE = "T3-L5"
"""The range over which a case has one error."""
AGAINST = {
    "cobb_deg": "Cobb angle before surgery [degrees]",
    "correction_percent": "correction [%]",
    "tets": "tetrahedra",
    "months_after": "months since surgery",
}
"""The covariates of an error, by their field in a row."""


@dataclass(frozen=True, kw_only=True)
class RangeSummary:
    """Back surface rotation over a range of levels; every number is a mean over patients."""

    error: Estimate | None
    """Mean absolute error of the prediction [degrees], by case and then by patient."""
    nothing_changes: Estimate | None
    """The same, had one said that the back stays as it was."""
    spline: Estimate | None
    """The same, had one moved the skin with the spline of the landmarks."""
    better_than_nothing: Estimate | None
    """How much smaller the error is than where nothing changes [degrees]; above 0 where the method helps."""
    better_than_spline: Estimate | None
    """How much smaller it is than that of the spline [degrees]."""
    within: Estimate | None
    """Share of a patient's levels whose error is below 2.5 degrees, from 0 to 1."""
    cases_within: Estimate | None
    """Share of cases whose mean error is below 2.5 degrees, which both papers ask for."""
    in_band: Estimate | None
    """Share of a patient's levels whose actual rotation lies in the prediction's 95 % band; None without bands."""


@dataclass(frozen=True)
class LevelSummary:
    """Back surface rotation at one level [degrees]."""

    error: Estimate
    """Mean absolute error."""
    bias: float
    """Mean error, predicted less actual."""
    nothing_changes: float
    """Mean absolute error, had one said that the back stays as it was."""
    spline: float
    """Mean absolute error of the skin moved with the spline."""


@dataclass(frozen=True)
class HumpSummary:
    """The largest hump [mm]."""

    error: Estimate
    """Mean absolute error."""
    agreement: LimitsOfAgreement
    """Predicted less actual."""
    line: Trend | None
    """The predicted hump over the actual one."""


@dataclass(frozen=True, kw_only=True)
class CohortSummary:
    """A cohort in numbers."""

    cases: int
    """Case folders."""
    counted: int
    """Cases that statistics take in."""
    patients: int
    """Patients that these are of."""
    failed: tuple[str, ...]
    """Cases without a result."""
    unfinished: tuple[str, ...]
    """Cases whose calculation did not converge; they do not count."""
    without_actual: tuple[str, ...]
    """Cases without an actual skin to be judged by."""
    bending: tuple[str, ...]
    """Cases of a patient who bends; they do not count among surgeries."""
    virtual: int
    """Cases that a computer made."""
    ranges: dict[str, RangeSummary]
    """By the ranges that the papers use."""
    levels: dict[str, LevelSummary]
    """By level, top to bottom."""
    agreement: LimitsOfAgreement | None
    """Of back surface rotation from T3 to L5 [degrees]."""
    hump: HumpSummary | None
    """The largest hump."""
    trends: dict[str, Trend | None]
    """Mean error of a case from T3 to L5 [degrees] over what it may go with; None where that is not known."""

    @property
    def complete(self) -> bool:
        """Whether every case has a result that converged."""
        return not (self.failed or self.unfinished)


def summarize_cohort(rows: Sequence[CaseRow]) -> CohortSummary:
    """The numbers of a cohort; only cases count that converged, after surgery, and have an actual skin."""
    counted = [row for row in rows if row.counts]
    known = [row for row in rows if row.status == CONVERGED]
    whole = level_errors(counted, WHOLE)
    errors = case_errors(counted)
    return CohortSummary(
        cases=len(rows),
        counted=len(counted),
        patients=len({row.patient for row in counted}),
        failed=tuple(row.folder for row in rows if row.status == FAILED),
        unfinished=tuple(row.folder for row in rows if row.status not in (FAILED, CONVERGED)),
        without_actual=tuple(r.folder for r in known if all(level.actual is None for level in r.levels)),
        bending=tuple(row.folder for row in known if row.pose == "bending"),
        virtual=sum(row.virtual for row in rows),
        ranges={name: _range(counted, name) for name in RANGES},
        levels=_levels(counted),
        agreement=limits_of_agreement([one.error for one in whole], [one.case.patient for one in whole]),
        hump=_hump(counted),
        trends={name: trend([getattr(row, name) for row in counted], errors) for name in AGAINST},
    )


def case_errors(rows: Sequence[CaseRow], of: str = WHOLE, guess: Guess = "predicted") -> list[float | None]:
    """The mean absolute error of every case over a range [degrees]; None where it has none."""
    return [None if (error := case_error(row, of, guess)) is None else error.mean for row in rows]


def _range(rows: Sequence[CaseRow], of: str) -> RangeSummary:
    def estimate(values: Iterable[float | None]) -> Estimate | None:
        known = [(value, row.patient) for value, row in zip(values, rows, strict=True) if value is not None]
        return over_patients([value for value, _ in known], [patient for _, patient in known])

    predicted, before, spline = (case_errors(rows, of, guess) for guess in ("predicted", "before", "spline"))
    gains = [
        [None if a is None or b is None else a - b for a, b in zip(errors, predicted, strict=True)]
        for errors in (before, spline)
    ]
    levels = [level_errors([row], of) for row in rows]
    return RangeSummary(
        error=estimate(predicted),
        nothing_changes=estimate(before),
        spline=estimate(spline),
        better_than_nothing=estimate(gains[0]),
        better_than_spline=estimate(gains[1]),
        within=estimate(share_true(abs(one.error) < DETECTABLE for one in case) for case in levels),
        cases_within=estimate(None if error is None else float(error < DETECTABLE) for error in predicted),
        in_band=estimate(share_true(one.in_band for one in case) for case in levels),
    )


def _levels(rows: Sequence[CaseRow]) -> dict[str, LevelSummary]:
    found = {}
    for level in RANGES[WHOLE]:
        predicted, before, spline = (
            [one for one in level_errors(rows, WHOLE, guess) if one.level == level]
            for guess in ("predicted", "before", "spline")
        )
        sizes = [[abs(one.error) for one in ones] for ones in (predicted, before, spline)]
        error = over_patients(sizes[0], [one.case.patient for one in predicted])
        if error is not None:
            bias = np.mean([one.error for one in predicted])
            found[level] = LevelSummary(error, *map(float, (bias, np.mean(sizes[1]), np.mean(sizes[2]))))
    return found


def _hump(rows: Sequence[CaseRow]) -> HumpSummary | None:
    humps = [(row.hump_predicted_mm, row.hump_actual_mm, row.patient) for row in rows]
    known = [(guess, actual, who) for guess, actual, who in humps if guess is not None and actual is not None]
    if not known:
        return None
    predicted, actual, patients = zip(*known, strict=True)
    differences = [a - b for a, b in zip(predicted, actual, strict=True)]
    error = over_patients([abs(difference) for difference in differences], patients)
    agreement = limits_of_agreement(differences, patients)
    assert error is not None
    assert agreement is not None
    return HumpSummary(error, agreement, trend(actual, predicted))
