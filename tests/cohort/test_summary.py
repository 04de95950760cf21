"""A cohort by hand: the papers' numbers of two patients, means, limits of agreement, shares and trends."""

import csv
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
from support.shown import check_shown, report_lines
from warp_trunk.cohort.cohort_page import (
    agreement_picture,
    cohort_text,
    levels_picture,
    worse_parts,
    write_cohort,
)
from warp_trunk.cohort.one_case import CaseRow
from warp_trunk.cohort.statistics import limits_of_agreement, over_patients, trend
from warp_trunk.cohort.summary import case_errors, errors, summarize_cohort
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


def test_who_counts():
    summary = summarize_cohort(ROWS)
    assert (summary.cases, summary.counted, summary.patients, summary.synthetic) == (6, 2, 2, 1)
    left_out = summary.failed, summary.unfinished, summary.without_actual, summary.bending
    assert left_out == (("e",), ("d",), ("c",), ("f",))
    assert not summary.complete
    assert summarize_cohort(ROWS[:3]).complete
    assert not summarize_cohort([*ROWS[:3], ROWS[3]]).complete  # not converged
    assert not summarize_cohort([*ROWS[:3], ROWS[4]]).complete  # failed


def test_the_papers_table_of_a_case():
    """T5 1, T6 3: mean 2, SD sqrt(2)."""
    (errors_of_case,) = case_errors(errors(ROWS[:1])).filter(range="T3-T12", guess="predicted").to_dicts()
    assert (errors_of_case["mean"], errors_of_case["sd"]) == (2.0, pytest.approx(2.0**0.5))


def test_ranges():
    """T3-L5: a has 1, 3, 1 and b 1, 3: means 5/3 and 2. Nothing changes: 5, 3, 1 and 8, 1; spline: 4, 0, 3 and
    4, 2."""
    rotations = summarize_cohort(ROWS).ranges["T3-L5"]
    means = {
        "error": (5.0 / 3.0 + 2.0) / 2.0,
        "nothing_changes": (3.0 + 4.5) / 2.0,
        "spline": (7.0 / 3.0 + 3.0) / 2.0,
        "better_than_nothing": (4.0 / 3.0 + 2.5) / 2.0,
        "better_than_spline": (2.0 / 3.0 + 1.0) / 2.0,
        "within": (2.0 / 3.0 + 0.5) / 2.0,
        "cases_within": 1.0,
        "in_band": (0.5 + 1.0) / 2.0,
    }
    assert {name: estimate and estimate.mean for name, estimate in vars(rotations).items()} == pytest.approx(means)
    error = not_none(rotations.error)
    assert error.sd == pytest.approx((1.0 / 3.0) / 2.0**0.5)


def test_levels_hump_and_trends():
    summary = summarize_cohort(ROWS)
    assert list(summary.levels) == ["T5", "T6", "L2"]
    t5 = summary.levels["T5"]
    assert (t5.error.mean, t5.error.sd, t5.bias, t5.nothing_changes, t5.spline) == (1.0, 0.0, 1.0, 6.5, 4.0)
    assert summary.levels["L2"].bias == -2.0  # -1 and -3
    hump, agreement = not_none(summary.hump), not_none(summary.agreement)
    assert (hump.error.mean, hump.agreement.bias) == (3.0, -2.0)  # +1 and -5
    assert (agreement.pairs, agreement.bias) == (5, pytest.approx((1 - 3 - 1 + 1 - 3) / 5))
    assert summary.trends["cobb_deg"] is None  # two cases have no trend
    assert summary.trends["months_after"] is None


@pytest.mark.parametrize("cases", [3, 9, 10])
def test_few_cases_have_no_trend_and_no_p(cases: int, tmp_path: Path) -> None:
    rows = [
        case(f"P{n}", level("L2", -4.0 - n % 3, -3.0, -9.0, -2.0), patient=f"P{n}", cobb_deg=40.0 + n)
        for n in range(cases)
    ]
    write_cohort(tmp_path, rows)
    page = (tmp_path / "cohort.html").read_text(encoding="utf-8")
    assert ("Regression of the error" in page, ">p</th>" in page) == (cases == 10, cases == 10)


def test_a_method_that_is_worse_than_doing_nothing_says_so_first(tmp_path: Path):
    """Lumbar errors of three patients are 3, 4 and 5, and 1 if nothing changed."""
    rows = [case(f"P{n}", level("L2", -4.0 - n, -3.0, -9.0, -2.0), patient=f"P{n}") for n in (1, 2, 3)]
    text = worse_parts(summarize_cohort(rows))[-1]
    assert "is 4.00 degrees, not 1.00; the difference is 3.00 (95 % interval 2.00 to 4.00)" in text
    write_cohort(tmp_path, rows)
    page = (tmp_path / "cohort.html").read_text(encoding="utf-8")
    assert page.index("predicted worse than by saying that nothing changes") < page.index("<table")


def test_cases_without_a_spine_are_judged_by_their_skins(tmp_path: Path):
    """Distances of 1 and 3 mm of two patients, where nothing changed 5 and 9."""

    def moved(name: str, error: float, unmoved: float) -> CaseRow:
        states = {"error": error, "before": unmoved}
        return case(
            name, [Measured(state, "", "distance_mean_mm", mm) for state, mm in states.items()], patient=name
        )

    rows = [moved("P1", 1.0, 5.0), moved("P2", 3.0, 9.0), *ROWS]
    summary = write_cohort(tmp_path, rows)
    assert summary.counted == 4
    assert {name: estimate and estimate.mean for name, estimate in summary.distance.items()} == {
        "error": 2.0,
        "nothing_changes": 7.0,
    }
    assert "actual skin 2.00 ± 1.41 mm over 2 patients; 7.00 mm if" in (tmp_path / "cohort.html").read_text(
        encoding="utf-8"
    )


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


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_every_file_of_a_cohort_has_its_numbers(tmp_path: Path) -> None:
    summary = write_cohort(tmp_path, ROWS)
    assert {path.name for path in tmp_path.iterdir()} == {"cases.csv", "cohort.csv", "cohort.json", "cohort.html"}
    cases = {row["folder"]: row for row in table(tmp_path / "cases.csv")}
    assert [(name, row["patient"], row["status"]) for name, row in cases.items()] == [
        (row.folder, row.patient, row.status) for row in ROWS
    ]
    assert (cases["a"]["cobb_deg"], cases["a"]["case"]) == ("50.0", "first")
    numbers = {
        (row["folder"], row["patient"], row["state"], row["level"]): float(row["value"])
        for row in table(tmp_path / "cohort.csv")
        if row["quantity"] == "bsr_deg" and row["value"]
    }
    assert numbers["a", "P1", "predicted", "T6"] == 6.0
    assert numbers["b", "P2", "actual", "L2"] == -5.0
    assert ("a", "P1", "actual", "L3") not in numbers
    record = json.loads((tmp_path / "cohort.json").read_text(encoding="utf-8"))
    assert [row["folder"] for row in record["cases"]] == [row.folder for row in ROWS]
    assert record["summary"]["counted"] == summary.counted == 2
    assert record["summary"]["agreement"]["bias"] == pytest.approx(-1.0)


def test_the_console_names_every_case_that_does_not_count_and_every_range() -> None:
    text = cohort_text(summarize_cohort(ROWS))
    assert "6 cases: 2 of 2 patients count; 1 are synthetic" in text
    for line in ("failed: e", "did not converge: d", "without an actual skin: c", "bending, not surgery: f"):
        assert line in text.splitlines()
    (whole,) = [line for line in text.splitlines() if line.startswith("T3-L5")]
    assert whole.endswith(
        "mean absolute error 1.83 ± 0.24° over patients; 3.75° if nothing changed, 2.67° by the spline; "
        "58 % of levels within 2.5°"
    )
    many = [CaseRow(folder=f"n{i:02}", status="FAILED", reason="") for i in range(14)]
    for count, words in ((12, "n10, n11"), (13, "n11 and 1 more"), (14, "n11 and 2 more")):
        (line,) = [row for row in cohort_text(summarize_cohort(many[:count])).splitlines() if "failed" in row]
        assert line.endswith(words)


def test_the_page_of_a_cohort_has_its_numbers_and_what_does_not_count_as_accepted(tmp_path: Path) -> None:
    (tmp_path / "study").mkdir()
    summary = write_cohort(tmp_path / "study", ROWS)
    page = Page((tmp_path / "study" / "cohort.html").read_text(encoding="utf-8"))
    pictures = {"levels": levels_picture(summary), "agreement": agreement_picture(ROWS, summary)}
    check_shown("cohort", [*report_lines(page, pictures), cohort_text(summary)])
    for text in (
        "e has no result: skin.ply: is <open>, 3 edges",
        "d did not converge and does not count.",
        "c has no actual skin to be judged by.",
    ):
        assert text in page.words
    assert any("1.83 ± 0.24" in cell for cells in page.rows.values() for cell in cells)


def test_every_sheet_of_a_cohort_names_it_its_day_and_its_numbers(tmp_path: Path) -> None:
    """The fingerprint changes with any number, and stays without a change."""
    (tmp_path / "study").mkdir()
    sheets = []
    for rows in (ROWS, ROWS, [replace(ROWS[0], measures=ROWS[0].measures[1:]), *ROWS[1:]]):
        write_cohort(tmp_path / "study", rows)
        page = (tmp_path / "study" / "cohort.html").read_text(encoding="utf-8")
        (sheet,) = re.findall(r'@bottom-left \{ content: "([^"]*)"', page)
        name, day, fingerprint = sheet.split(" · ")
        assert (name, len(fingerprint)) == ("study", 14)
        assert date.fromisoformat(day) <= date.today()
        sheets.append(fingerprint)
    assert sheets[0] == sheets[1] != sheets[2]


def test_pictures_of_a_cohort_have_every_point_at_its_place_and_the_limits_of_agreement() -> None:
    summary = summarize_cohort(ROWS)
    axes: Any = agreement_picture(ROWS, summary).axes[0]
    lines = {str(line.get_label()): line for line in axes.lines}
    # T5 5 and 4, T6 6 and 9 of a; T5 7 and 6 of b
    assert sorted(zip(*lines["thoracic"].get_data(), strict=True)) == [(4.5, 1.0), (6.5, 1.0), (7.5, -3.0)]
    assert sorted(zip(*lines["lumbar"].get_data(), strict=True)) == [(-6.5, -3.0), (-1.5, -1.0)]
    agreement = not_none(summary.agreement)
    limits = {text.get_text(): text.xy[1] for text in axes.texts}
    assert limits.pop("mean −1.0" if "mean −1.0" in limits else "mean -1.0") == agreement.bias
    at = sorted(float(line.get_ydata()[0]) for line in axes.lines if str(line.get_label()).startswith("_"))
    limits_shown = [row for row in (agreement.low, agreement.bias, agreement.high) if row is not None]
    assert at == pytest.approx(sorted(limits_shown))
    axes = levels_picture(summary).axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["T5", "T6", "L2"]
    lines = {str(line.get_label()): line for line in axes.lines}
    np.testing.assert_allclose(lines["nothing changes"].get_xdata(), [6.5, 3.0, 1.0])
    np.testing.assert_allclose(lines["the spline carries the skin"].get_xdata(), [4.0, 0.0, 2.5])
    np.testing.assert_array_equal(lines["nothing changes"].get_ydata(), [0, 1, 2])
    low, high = axes.get_ylim()
    assert low > 2.0 > 0.0 > high  # T5 on top
