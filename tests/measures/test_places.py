"""A maximum is compared at the place that it has in the reference, whatever is largest elsewhere afterwards."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from support.asserting import not_none
from support.known_spine import known_spine
from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.cohort.one_case import CaseRow
from warp_trunk.cohort.summary import summarize_cohort
from warp_trunk.measures import TrunkMeasures
from warp_trunk.measures.back_rotation import Contacts, DualTangent
from warp_trunk.measures.measures import measure_spine
from warp_trunk.measures.quantities import ACTUAL, BEFORE, PREDICTED, QUANTITIES, MeasureTable, measured
from warp_trunk.measures.rows import measure_rows
from warp_trunk.report.plans import apart_of

MAXIMA = {quantity.key: quantity for quantity in QUANTITIES.values() if quantity.largest_of}
SPINE = measure_spine(known_spine(to_left={"T1": 28.0, "T5": 30.0, "T12": -30.0, "L5": -28.0}))


def back(rotations: Mapping[str, float], humps: Mapping[str, float] | None = None) -> TrunkMeasures:
    """A back whose rotation, a tenth less than its slope, and hump are given by level; 0 where left out."""
    nowhere, contacts = np.zeros(2), Contacts(np.zeros((2, 2)), np.zeros((2, 2, 2)), np.zeros((2, 2)))
    tangents = {
        level: DualTangent(0.0, contacts, rotations.get(level, 0.0), np.zeros((1, 2)), nowhere, nowhere)
        for level in VERTEBRAE
    }
    slopes = {level: 1.1 * rotations.get(level, 0.0) for level in VERTEBRAE}
    trunk = replace(SPINE, tangents=tangents, slopes=slopes)
    trunk.__dict__["hump_height"] = {level: (humps or {}).get(level, 0.0) for level in VERTEBRAE}
    return trunk


def drawn(random: np.random.Generator) -> TrunkMeasures:
    return back(*(dict(zip(VERTEBRAE, random.normal(0.0, 9.0, len(VERTEBRAE)), strict=True)) for _ in range(2)))


@pytest.mark.parametrize("seed", range(20))
def test_no_difference_of_two_plans_exceeds_the_largest_by_level(seed: int) -> None:
    random = np.random.default_rng(seed)
    states = {name: drawn(random) for name in (BEFORE, "A", "B", "C")}
    table = MeasureTable.of(states)
    apart = apart_of(measure_rows(table, states[BEFORE], [*states]), [*states], [None] * 3)
    for key, maximum in MAXIMA.items():
        differences = {gap.title: abs(gap.value) for gap in apart if gap.row.quantity.key == key}
        assert len(differences) == 3
        for plan, other in combinations("ABC", 2):
            columns = [table.values(name, maximum.largest_of) for name in (plan, other)]
            by_level = [abs(not_none(columns[0][level]) - not_none(columns[1][level])) for level in maximum.levels]
            assert differences[f"{plan} against {other}"] <= max(by_level)


def test_two_plans_whose_largest_lumbar_rotations_are_on_other_sides_are_alike() -> None:
    """The largest are 4.7 left at L3 and 4.6 right at L1, though no level differs by more than 0.9."""
    a = {"L1": 4.5, "L2": 1.0, "L3": -4.7, "L4": -2.0, "L5": 0.0}
    b = {"L1": 4.6, "L2": 1.3, "L3": -3.8, "L4": -2.9, "L5": 0.4}
    states = {BEFORE: back({"L2": 9.0}), "A": back(a), "B": back(b)}
    table = MeasureTable.of(states)
    apart = apart_of(measure_rows(table, states[BEFORE], [*states]), [*states], [None] * 2)
    (lumbar,) = [difference for difference in apart if difference.row.quantity.key == "lumbar_bsr_deg"]
    assert (lumbar.row.level, lumbar.value) == ("L2", pytest.approx(-0.3))
    assert not lumbar.differs
    elsewhere = [not_none(table.elsewhere(name, "lumbar_bsr_deg")) for name in "AB"]
    assert [(row.level, row.value) for row in elsewhere] == [("L3", -4.7), ("L1", 4.6)]


def test_a_hump_is_followed_where_it_is_and_the_larger_one_is_found() -> None:
    states = {BEFORE: back({}, {"T12": 25.0, "T8": 20.0}), PREDICTED: back({}, {"T12": 10.0, "T8": 17.0})}
    table = MeasureTable.of(states)
    assert table.place("main_hump_mm") == "T12"
    assert [table.value(state, "main_hump_mm", "T12") for state in states] == [25.0, 10.0]
    larger = not_none(table.elsewhere(PREDICTED, "main_hump_mm"))
    assert (larger.quantity, larger.level, larger.value) == ("hump_mm", "T8", 17.0)
    assert table.elsewhere(BEFORE, "main_hump_mm") is None
    as_large = MeasureTable.of({BEFORE: states[BEFORE], PREDICTED: back({}, {"T12": 10.0, "T11": -10.2})})
    assert as_large.elsewhere(PREDICTED, "main_hump_mm") is None


def test_the_hump_of_a_cohort_is_judged_at_one_place() -> None:
    """The largest are 16.6 left at T8 and 15.0 right at L4: 31.6 mm apart, where each place is wrong by 0.5 to
    1.8."""
    before, predicted = back({}, {"T8": -25.0}), back({}, {"T8": -16.6, "L4": 14.5})
    actual = back({}, {"T8": -14.8, "L4": 15.0})
    states = {BEFORE: before, PREDICTED: predicted, ACTUAL: actual, "spline": predicted}
    rows = tuple(row for state, trunk in states.items() for row in measured(state, trunk, before))
    case = CaseRow(folder="P", patient="P", status="CONVERGED", measures=rows)
    assert not_none(summarize_cohort([case]).hump).error.mean == pytest.approx(1.8)


def test_t1_and_t2_decide_no_maximum() -> None:
    states = {
        BEFORE: back({"T1": 68.0, "T2": -27.0, "T7": 12.0}, {"T1": 30.0, "T7": 9.0}),
        PREDICTED: back({"T1": 21.0}),
    }
    table = MeasureTable.of(states)
    assert {key: table.place(key) for key in ("thoracic_bsr_deg", "main_hump_mm")} == {
        "thoracic_bsr_deg": "T7", "main_hump_mm": "T7",
    }  # fmt: skip
    assert table.largest(BEFORE, "bsr_deg") == "T7"
    assert table.elsewhere(PREDICTED, "thoracic_bsr_deg") is None
    measures = states[BEFORE]
    assert (measures.max_thoracic_bsr, measures.worst_level, measures.hump_level) == (12.0, "T7", "T7")
