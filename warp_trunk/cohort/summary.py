"""The summary of a whole cohort: group-by over the rows of all its cases. Imports polars, which the extra
`cluster` brings."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass

import polars as pl

from warp_trunk.measures.comparison import RANGES
from warp_trunk.measures.quantities import DETECTABLE

from .one_case import CONVERGED, FAILED, CaseRow
from .statistics import LimitsOfAgreement, PatientMean, Trend, limits_of_agreement, over_patients, trend

WHOLE = "T3-L5"
"""The range over which a case has one error."""
AGAINST = {
    "cobb_deg": "Cobb angle before surgery [degrees]",
    "correction_percent": "correction [%]",
    "tets": "tetrahedra",
    "months_after": "months since surgery",
}
"""The covariates of an error, by their field in a row."""
FEWEST_CASES = 10
"""Fewer cases have no trend: a line through three has a correlation of 0.99 by chance in one of eleven."""
GUESSES = ("predicted", "before", "spline")
"""Guesses that are compared with the actual skin: the prediction, "nothing changes", and "the spline carries the
skin"."""


@dataclass(frozen=True, kw_only=True)
class RangeEstimates:
    """Means over patients for one range of levels."""

    error: PatientMean | None
    """Mean absolute error of the prediction [degrees], by case and then by patient."""
    nothing_changes: PatientMean | None
    """The same of the guess that nothing changes."""
    spline: PatientMean | None
    """The same of the skin carried by the spline."""
    better_than_nothing: PatientMean | None
    """How much smaller the error is [degrees], above 0 where the method helps."""
    better_than_spline: PatientMean | None
    """Likewise."""
    within: PatientMean | None
    """Share of a patient's levels whose error is below 2.5 degrees, from 0 to 1."""
    cases_within: PatientMean | None
    """Share of cases whose mean error is below 2.5 degrees, which both papers ask for."""
    in_band: PatientMean | None
    """Share of a patient's levels whose actual rotation lies in the prediction's 95 % interval."""


@dataclass(frozen=True)
class LevelSummary:
    """Back surface rotation at one level [degrees]."""

    error: PatientMean
    """Mean absolute error."""
    bias: float
    """Mean error, predicted less actual."""
    nothing_changes: float
    """Mean absolute error, had one said that the back stays as it was."""
    spline: float
    """Mean absolute error of the skin moved with the spline."""


@dataclass(frozen=True)
class HumpSummary:
    """The hump where it is largest before surgery [mm]."""

    error: PatientMean
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
    synthetic: int
    """Cases that a computer made."""
    ranges: dict[str, RangeEstimates]
    """By the ranges that the papers use."""
    lenke: dict[str, PatientMean | None]
    """Mean absolute error of the prediction from T3 to L5 [degrees] by curve type, Lenke 1 to 6."""
    levels: dict[str, LevelSummary]
    """By level, top to bottom."""
    agreement: LimitsOfAgreement | None
    """Of back surface rotation from T3 to L5 [degrees]."""
    hump: HumpSummary | None
    """The hump, where it is largest before surgery."""
    distance: dict[str, PatientMean | None]
    """Mean distance from the actual skin [mm] of cases without a spine: of the prediction (`error`), and of the
    skin before surgery (`nothing_changes`)."""
    trends: dict[str, Trend | None]
    """Mean error of a case from T3 to L5 [degrees] over what it may go with; None where that is not known."""

    @property
    def complete(self) -> bool:
        """Whether every case has a result that converged."""
        return not (self.failed or self.unfinished)


def tidy(rows: Iterable[CaseRow]) -> pl.DataFrame:
    """Every measured number of some cases, with its `folder` and `patient`."""
    schema = {name: pl.String for name in ("folder", "patient", "state", "level", "quantity")}
    schema |= {name: pl.Float64 for name in ("value", "low", "high")}
    numbers = (
        {"folder": row.folder, "patient": row.patient, **asdict(number)} for row in rows for number in row.measures
    )
    return pl.DataFrame(list(numbers), schema)


def errors(rows: Iterable[CaseRow]) -> pl.DataFrame:
    """Back surface rotation of some cases by folder, patient, guess and level: guessed, actual, error and
    `in_band`.

    Only levels at which all three guesses and the actual rotation are known are taken, so that guesses are
    compared at the same places.
    """
    rotations = tidy(rows).filter(quantity="bsr_deg")
    key, states = ["folder", "patient", "level"], (*GUESSES, "actual")
    wide = rotations.pivot("state", on_columns=states, index=key, values="value").drop_nulls()
    inside = pl.col("actual").is_between(pl.col("low"), pl.col("high"))
    bands = rotations.filter(state="predicted").select(*key, "low", "high")
    return (
        wide.join(bands, key, maintain_order="left")
        .select(*key, *states, in_band=inside.cast(pl.Float64))
        .unpivot(GUESSES, index=[*key, "actual", "in_band"], variable_name="guess", value_name="guessed")
        .with_columns(error=pl.col("guessed") - pl.col("actual"))
    )


def case_errors(of: pl.DataFrame) -> pl.DataFrame:
    """`errors` of each case over the ranges of the papers: mean absolute error, its SD, and shares of levels."""
    by_range = [
        of.filter(pl.col("level").is_in(levels)).with_columns(range=pl.lit(name))
        for name, levels in RANGES.items()
    ]
    size = pl.col("error").abs()
    return (
        pl.concat(by_range)
        .group_by("range", "folder", "patient", "guess", maintain_order=True)
        .agg(mean=size.mean(), sd=size.std(), within=(size < DETECTABLE).mean(), in_band=pl.col("in_band").mean())
    )


def summarize_cohort(rows: Sequence[CaseRow]) -> CohortSummary:
    """The numbers of a cohort; only cases count that converged, after surgery, and have an actual skin."""
    counted = [row for row in rows if row.counts]
    converged = [row for row in rows if row.status == CONVERGED]
    table = errors(counted)
    cases, predicted = case_errors(table), table.filter(pl.col("level").is_in(RANGES[WHOLE]), guess="predicted")
    whole = dict(cases.filter(range=WHOLE, guess="predicted").select("folder", "mean").iter_rows())
    return CohortSummary(
        cases=len(rows),
        counted=len(counted),
        patients=len({row.patient for row in counted}),
        failed=tuple(row.folder for row in rows if row.status == FAILED),
        unfinished=tuple(row.folder for row in rows if row.status not in (FAILED, CONVERGED)),
        without_actual=tuple(row.folder for row in converged if not row.judged),
        bending=tuple(row.folder for row in converged if row.pose == "bending"),
        synthetic=sum(row.synthetic for row in rows),
        ranges={name: _estimates(cases.filter(range=name)) for name in RANGES},
        lenke={
            kind: _mean(
                cases.filter(pl.col("folder").is_in(folders), range=WHOLE, guess="predicted").rename(
                    {"mean": "value"}
                )
            )
            for kind, folders in sorted(_by_type(counted).items())
        },
        levels={level: at for level in RANGES[WHOLE] if (at := _level(table.filter(level=level)))},
        agreement=limits_of_agreement(predicted["error"].to_list(), predicted["patient"].to_list()),
        hump=_hump(tidy(counted).filter(quantity="main_hump_mm")),
        distance={
            name: _mean(tidy(counted).filter(state=state, level="", quantity="distance_mean_mm"))
            for name, state in (("error", "error"), ("nothing_changes", "before"))
        },
        trends={
            name: trend(
                [getattr(row, name) for row in counted], [whole.get(row.folder) for row in counted], FEWEST_CASES
            )
            for name in AGAINST
        },
    )


def _estimates(cases: pl.DataFrame) -> RangeEstimates:
    """Every estimate of a range, from the errors of its cases."""
    key = ["folder", "patient"]
    means = cases.pivot("guess", on_columns=GUESSES, index=key, values="mean")
    shares = cases.filter(guess="predicted").select(*key, "within", "in_band")
    predicted = pl.col("predicted")
    numbers = means.join(shares, key, maintain_order="left").select(
        "patient",
        error=predicted,
        nothing_changes="before",
        spline="spline",
        better_than_nothing=pl.col("before") - predicted,
        better_than_spline=pl.col("spline") - predicted,
        within="within",
        cases_within=(predicted < DETECTABLE).cast(pl.Float64),
        in_band="in_band",
    )

    def estimate(name: str) -> PatientMean | None:
        values = numbers.select("patient", name).drop_nulls()
        return over_patients(values[name].to_list(), values["patient"].to_list())

    return RangeEstimates(**{name: estimate(name) for name in numbers.columns[1:]})


def _by_type(rows: Sequence[CaseRow]) -> dict[str, list[str]]:
    """The folders of cases by curve type, without the lumbar modifier."""
    by_type: dict[str, list[str]] = {}
    for row in rows:
        if row.lenke:
            by_type.setdefault(row.lenke[0], []).append(row.folder)
    return by_type


def _mean(numbers: pl.DataFrame) -> PatientMean | None:
    return over_patients(numbers["value"].to_list(), numbers["patient"].to_list())


def _level(of: pl.DataFrame) -> LevelSummary | None:
    predicted = of.filter(guess="predicted")
    error = over_patients(predicted["error"].abs().to_list(), predicted["patient"].to_list())
    if error is None:
        return None
    means = dict(of.group_by("guess").agg(pl.col("error").abs().mean()).iter_rows())
    bias = predicted.select(pl.col("error").mean()).item()
    return LevelSummary(error, bias, nothing_changes=means["before"], spline=means["spline"])


def _hump(humps: pl.DataFrame) -> HumpSummary | None:
    states = ("predicted", "actual")
    pairs = humps.pivot("state", on_columns=states, index=["folder", "patient"], values="value").drop_nulls()
    predicted, actual, patients = (pairs[name].to_list() for name in (*states, "patient"))
    differences = [a - b for a, b in zip(predicted, actual, strict=True)]
    error = over_patients([abs(difference) for difference in differences], patients)
    agreement = limits_of_agreement(differences, patients)
    if error is None or agreement is None:
        return None
    return HumpSummary(error, agreement, trend(actual, predicted, FEWEST_CASES))
