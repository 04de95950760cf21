"""A cohort by hand: the papers' numbers of two patients, means, limits of agreement, shares and trends."""

import json
import re
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.asserting import not_none
from support.drawn import Page
from support.shown import check_shown, record_lines, report_lines
from warp_trunk.cohort.cohort_page import (
    agreement_picture,
    cohort_text,
    levels_picture,
    write_cohort,
)
from warp_trunk.cohort.one_case import CaseRow
from warp_trunk.cohort.statistics import limits_of_agreement, over_patients, trend
from warp_trunk.cohort.summary import summarize_cohort
from warp_trunk.measures.quantities import Measured


def level(
    name: str, predicted: float, before: float, spline: float, actual: float | None, *, band: bool | None = None
) -> list[Measured]:
    values = {"before": before, "spline": spline, "actual": actual}
    rows = [Measured(state, name, "bsr_deg", value) for state, value in values.items()]
    if band is None:
        return [*rows, Measured("predicted", name, "bsr_deg", predicted)]
    low = -99.0 if band else 98.0
    return [*rows, Measured("predicted", name, "bsr_deg", predicted, low, 99.0)]


def case(
    folder: str, *rows: list[Measured], hump: tuple[float, float, float] | None = None, **columns: Any
) -> CaseRow:
    states = zip(("before", "predicted", "actual"), hump or (), strict=False)
    humps = [Measured(state, "T8", "main_hump_mm", value) for state, value in states]
    measures = (*humps, *(row for several in rows for row in several))
    return CaseRow(**{"folder": folder, "status": "CONVERGED", "measures": measures, **columns})


ROWS = [
    case(
        "a",
        level("T5", 5.0, 9.0, 8.0, 4.0, band=True),
        level("T6", 6.0, 12.0, 9.0, 9.0, band=False),
        level("L2", -2.0, 0.0, -4.0, -1.0),
        level("L3", -3.0, 0.0, 0.0, None),
        hump=(20.0, 11.0, 10.0), case="first", patient="P1", synthetic=True, cobb_deg=50.0, tets=1000,
    ),
    case(
        "b",
        level("T5", 7.0, 14.0, 10.0, 6.0, band=True),
        level("L2", -8.0, -6.0, -7.0, -5.0, band=True),
        hump=(30.0, 9.0, 14.0), case="second", patient="P2", cobb_deg=60.0, tets=1000,
    ),
    case("c", level("T5", 1.0, 2.0, 3.0, None), patient="P3"),
    case("d", level("T5", 1.0, 2.0, 3.0, 99.0), patient="P4", status="STALLED"),
    CaseRow(folder="e", status="FAILED", reason="skin.ply: is <open>, 3 edges"),
    case("f", level("T5", 1.0, 2.0, 3.0, 99.0), patient="P2", pose="bending"),
]  # fmt: skip


MANY = [
    case(
        f"{n:02}",
        level("T5", 5.0 + n % 4, 9.0, 8.0 - n % 2, 5.0, band=n % 3 > 0),
        level("L2", -4.0 - n % 3, -3.0, -3.5, -2.0),
        hump=(20.0, 9.0 + n, 10.0 + 2.0 * (n % 3)),
        patient=f"P{n}", cobb_deg=40.0 + n, lenke=("1A", "1B", "5C")[n % 3], months_after=6.0 * n,
    )
    for n in range(10)
] + [
    case(name, [Measured(state, "", "distance_mean_mm", mm) for state, mm in mms.items()], patient=name)
    for name, mms in {"Q1": {"error": 1.0, "before": 5.0}, "Q2": {"error": 3.0, "before": 7.0}}.items()
] + [CaseRow(folder=f"z{n:02}", status="FAILED", reason="no skin") for n in range(14)]  # fmt: skip
"""Ten patients, of whom a trend is asked for; two parts of the body; more failures than the console lists."""


@pytest.mark.parametrize(("name", "rows"), [("cohort", ROWS), ("cohort_of_many", MANY)])
def test_the_page_the_files_and_the_console_of_a_cohort_are_as_accepted(
    name: str, rows: list[CaseRow], tmp_path: Path
) -> None:
    """By hand: errors of "a" are 1, 3, 1 and those of "b" 1, 3 from T3 to L5, so 5/3 and 2 and in the mean 1.83.

    Nothing changes: 5, 3, 1 and 8, 1; the spline: 4, 0, 3 and 4, 2. Of "many" the lumbar errors are 2, 3 and 4,
    and 1 if nothing changed; of the two parts the distances are 1 and 3 mm, and 5 and 7 before.
    """
    summary = write_cohort(tmp_path, rows)
    page = Page((tmp_path / "cohort.html").read_text(encoding="utf-8"))
    pictures = {"levels": levels_picture(summary), "agreement": agreement_picture(rows, summary)}
    record = json.loads((tmp_path / "cohort.json").read_text(encoding="utf-8"))
    files = [(tmp_path / file).read_text(encoding="utf-8") for file in ("cases.csv", "cohort.csv")]
    lines = [
        *report_lines(page, pictures),
        cohort_text(summary),
        *files,
        *record_lines(record["summary"], "summary"),
    ]
    check_shown(name, lines)
    assert [row["folder"] for row in record["cases"]] == [row.folder for row in rows]


@pytest.mark.parametrize(
    ("rows", "complete"), [(ROWS[:3], True), ([*ROWS[:3], ROWS[3]], False), ([*ROWS[:3], ROWS[4]], False)]
)
def test_a_cohort_is_complete_where_every_case_converged(rows: list[CaseRow], complete: bool) -> None:
    assert summarize_cohort(rows).complete == complete


def test_fewer_than_ten_cases_have_no_trend() -> None:
    few, enough = (summarize_cohort(MANY[:count]).trends["cobb_deg"] for count in (9, 10))
    assert few is None
    assert enough is not None


def test_each_patient_counts_once():
    """Patient a: (1 + 3) / 2 = 2; b: 5; c: 8. Mean 5, deviations -3, 0, 3, so SD 3."""
    mean = not_none(over_patients([1.0, 3.0, 5.0, 8.0], ["a", "a", "b", "c"]))
    assert (mean.mean, mean.sd, mean.patients) == (5.0, 3.0, 3)


def test_an_interval_of_three_patients_goes_from_the_least_to_the_most():
    """All three draws are the least patient in 1 of 27, more often than 2.5 %."""
    mean = not_none(over_patients([2.0, 5.0, 8.0], ["a", "b", "c"]))
    assert (mean.low, mean.high) == (2.0, 8.0)


def test_the_interval_of_many_patients_is_the_normal_one():
    """Of 200 patients, 100 at 0 and 100 at 1: standard error 0.5 / sqrt(200) = 0.0354."""
    mean = not_none(over_patients([0.0, 1.0] * 100, [str(n) for n in range(200)]))
    assert mean.low == pytest.approx(0.5 - 1.96 * 0.0354, abs=0.006)
    assert mean.high == pytest.approx(0.5 + 1.96 * 0.0354, abs=0.006)


@pytest.mark.parametrize(("values", "sd"), [([2.0], None), ([2.0, 4.0], np.sqrt(2.0))])
def test_few_patients_have_no_interval(values, sd):
    mean = not_none(over_patients(values, [str(n) for n in range(len(values))]))
    assert mean.sd == (None if sd is None else pytest.approx(sd))
    assert mean.low is None
    assert mean.high is None


def test_one_pair_each_is_the_plain_limit():
    """1, 2, 3: mean 2, SD 1, limits 2 ± 1.96."""
    limits = not_none(limits_of_agreement([1.0, 2.0, 3.0], ["a", "b", "c"]))
    assert (limits.bias, limits.sd) == (2.0, 1.0)
    assert (limits.low, limits.high) == (pytest.approx(0.04), pytest.approx(3.96))


def test_several_pairs_add_what_lies_within_and_between_patients():
    """a: 0, 2; b: 4, 6. Within: (1 + 1 + 1 + 1) / (4 - 2) = 2. Between: 2 (4 + 4) / 1 = 16. Pairs of each:
    (4 - 8 / 4) / 1 = 2. Variance of patients (16 - 2) / 2 = 7, of a difference 2 + 7 = 9."""
    limits = not_none(limits_of_agreement([0.0, 2.0, 4.0, 6.0], ["a", "a", "b", "b"]))
    assert (limits.bias, limits.sd, limits.pairs, limits.patients) == (3.0, 3.0, 4, 2)
    alike = not_none(limits_of_agreement([-1.0, 1.0, -1.0, 1.0], ["a", "a", "b", "b"]))
    assert alike.sd == pytest.approx(2.0**0.5)  # patients that do not differ add nothing


def test_limits_hold_what_they_promise():
    """Of single differences of new patients, 95 %: 12 levels each, patients vary by 2 and levels by 1."""
    random = np.random.default_rng(3)
    drawn = random.normal(0.0, 2.0, (2000, 1)) + random.normal(0.0, 1.0, (2000, 12))
    cases = np.repeat(np.arange(2000), 12).astype(str).tolist()
    limits = not_none(limits_of_agreement(drawn.ravel().tolist(), cases))
    assert limits.sd == pytest.approx(np.sqrt(5.0), rel=0.03)


def test_a_line_by_hand():
    """Points (0, 1), (1, 3), (2, 2): slope 1 / 2, intercept 1.5, correlation 1 / sqrt(2 * 2) = 0.5."""
    line = not_none(trend([0.0, 1.0, None, 2.0, 9.0], [1.0, 3.0, 7.0, 2.0, None]))
    assert (line.slope, line.intercept, line.correlation) == (
        pytest.approx(0.5), pytest.approx(1.5), pytest.approx(0.5),
    )  # fmt: skip
    assert line.p == pytest.approx(
        2.0 / 3.0
    )  # t = 0.5 / sqrt(0.75) = 1 / sqrt(3), one degree of freedom: 60 degrees
    assert line.points == 3


def test_every_sheet_of_a_cohort_names_it_its_day_and_its_numbers(tmp_path: Path) -> None:
    """The fingerprint changes with any number, and stays without a change."""
    (tmp_path / "study").mkdir()
    sheets = []
    for rows in (ROWS[2:3], ROWS[2:3], [replace(ROWS[2], measures=ROWS[2].measures[1:])]):
        write_cohort(tmp_path / "study", rows)
        page = (tmp_path / "study" / "cohort.html").read_text(encoding="utf-8")
        (sheet,) = re.findall(r'@bottom-left \{ content: "([^"]*)"', page)
        name, day, fingerprint = sheet.split(" · ")
        assert (name, len(fingerprint)) == ("study", 14)
        assert date.fromisoformat(day) <= date.today()
        sheets.append(fingerprint)
    assert sheets[0] == sheets[1] != sheets[2]
