"""Plans side by side: what the page shows, what it says that differs, and which plans it refuses to compare."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from support.known_patient import write_known_result
from support.known_spine import known_spine
from support.report_results import write_small_result
from support.trunk_shapes import posed
from warp_trunk.errors import InputError
from warp_trunk.measures.quantities import QUANTITIES, Measured, MeasureTable
from warp_trunk.measures.rows import MeasureRow, measure_rows
from warp_trunk.report.plans import Apart, apart_of, apart_table, apart_text, differences
from warp_trunk.report.plots import rotation_plot
from warp_trunk.report.style import BEFORE, PLANS
from warp_trunk.report.writing import write_comparison
from warp_trunk.results import read_result
from warp_trunk.results.bands import Effects

CURVE = {"T1": 28.0, "T5": 30.0, "T12": -30.0, "L5": -28.0}


def pose(look, share, turn):
    """A trunk turned by an angle, and a spine with a share of a curve of 60 degrees."""
    return posed(look, known_spine(to_left={level: share * tilt for level, tilt in CURVE.items()}), turn)


@pytest.fixture(scope="module")
def three():
    return pose(BEFORE, 1.0, 12.0), [pose(PLANS[0], 0.3, 7.0), pose(PLANS[1], 0.5, 6.0)]


def apart_between(before, plans, effects):
    states = {pose.look.title: pose.measures for pose in (before, *plans)}
    groups = measure_rows(MeasureTable.of(states), before.measures, [*states])
    return apart_of(groups, [*states], effects)


def effects_of(shift):
    """Effects of one plan: an error that both plans share, and one by which they differ."""
    names = [["thoracic_bsr_deg", "T3"], ["main_hump_mm", "T3"], ["cobb_deg", "T5-T12"]]
    return Effects(
        names=np.array(names), sources=np.array(["shared", "own"]), effects=np.array([[9.0, shift]] * 3),
        landmarks=np.zeros((3, 6)), ratio=np.ones(3), likely_worse=np.zeros((8, 3)),
    )  # fmt: skip


def test_what_differs_is_told_with_each_plan_and_the_rest_is_alike(three):
    before, plans = three
    apart = apart_between(before, plans, [effects_of(0.5), effects_of(1.5)])
    told = differences([before, *plans], apart)
    assert "Cobb angle T5 to T12: 18° with plan A and 30° with plan B." in told
    *_, alike = told
    assert alike.startswith("Too alike to choose by, within 5° of the spine, 2.5° of the back and 5 mm")
    assert "rotation of the upper back" in alike  # 7 and 6 degrees
    assert "Cobb" not in alike
    cobb = next(gap for gap in apart if gap.row.quantity.key == "cobb_deg" and gap.row.level == "T5-T12")
    assert (cobb.value, cobb.title) == (pytest.approx(-12.0, abs=0.1), "A against B")
    assert cobb.high is not None
    assert cobb.high - cobb.value == pytest.approx(1.96, abs=1e-3)  # what is shared cancels
    distance = next(line for line in told if line.startswith("The predicted skins"))
    most, mean = map(float, re.findall(r"([\d.]+) mm", distance))
    assert most == round(math.hypot(150.0, 100.0) * math.radians(1.0), 1)  # its corners, turned by one degree
    assert 0 < mean <= most


def test_plans_within_the_interval_of_their_difference_are_alike(three):
    before, plans = three
    apart = apart_between(before, plans, [effects_of(0.0), effects_of(8.0)])
    assert not any(gap.differs for gap in apart if gap.row.quantity.key == "cobb_deg" and gap.low is not None)
    cells = {row[0]: row[1] for row in apart_table(apart)}
    assert re.fullmatch(r"not known \(28 better to 3.\d worse\)", cells["Cobb angle T5 to T12 [°]"])


def test_another_patient_a_plan_given_twice_and_too_many_are_refused(tmp_path):
    first_plan, other = write_small_result(tmp_path / "one"), write_known_result(tmp_path / "other")
    with pytest.raises(InputError, match=r"other: skin and landmarks before surgery must be those of .*one"):
        write_comparison([read_result(first_plan), read_result(other)])
    with pytest.raises(InputError, match="is given twice"):
        write_comparison([read_result(first_plan)] * 3)
    with pytest.raises(InputError, match="from 2 to 4 results"):
        write_comparison([read_result(first_plan)] * 5)


def test_t1_and_t2_set_no_scale_of_the_rotations(three):
    before, _ = three
    rows = [
        Measured(row.state, row.level, row.quantity, 80.0 if row.level in ("T1", "T2") else 9.0)
        for row in before.table.rows
        if row.quantity == "bsr_deg"
    ]
    (axes,) = rotation_plot([replace(before, table=MeasureTable(rows))]).axes
    least, most = axes.get_xlim()
    assert -4.0 < least < most < 12.0


@pytest.mark.parametrize(
    ("first", "second", "text"),
    [(-12, -6, "6.0 worse"), (12, 6, "6.0 worse"), (-6, -12, "6.0 better"), (6, -3, "9.0, other side")],
)
def test_the_better_plan_is_the_one_with_the_smaller_size(first, second, text):
    numbers = tuple(
        Measured(name, "T8", "main_hump_mm", size) for name, size in zip("0AB", (9.0, first, second), strict=True)
    )
    row = MeasureRow(quantity=QUANTITIES["main_hump_mm"], level="T8", numbers=numbers)
    assert apart_text(Apart(row, "A against B", first - second, (first, second), None, None)) == text
