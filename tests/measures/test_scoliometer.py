"""The slope of a standing back, on backs whose slope is known, and the forward bend that follows from it."""

import math

import numpy as np
import pytest

from support.asserting import not_none
from support.phantoms import whole_phantom
from support.trunk_shapes import ellipse, flat_back
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.measures import measure, measure_back
from warp_trunk.measures.quantities import Measured, MeasureTable
from warp_trunk.measures.scoliometer import forward_bend, scoliometer_on, slope_between
from warp_trunk.report.sentences import bent

ACROSS = np.array([1.0, 0.0])


def test_thoracic_points_lie_45_mm_beside_the_spine_and_lumbar_ones_35() -> None:
    for level, wide in (("T12", 90.0), ("L1", 70.0)):
        ends = scoliometer_on(ellipse(), np.array([0.0, 45.0]), ACROSS, 0.0, level)
        assert ends is not None
        assert ends[0, 0] - ends[1, 0] == pytest.approx(wide)
        assert ends[0, 1] == pytest.approx(100.0 * math.sqrt(1.0 - (wide / 300.0) ** 2), abs=0.02)


def test_a_turned_vertebra_has_its_spinous_process_aside() -> None:
    """45 mm in front of a flat back, turned by 10 degrees counterclockwise: the process goes to the right."""
    ends = scoliometer_on(flat_back(), np.array([3.0, 55.0]), ACROSS, math.radians(10.0), "T8")
    assert ends is not None
    assert ends[:, 0].mean() == pytest.approx(3.0 - 45.0 * math.tan(math.radians(10.0)))
    assert slope_between(np.array([[45.0, 0.0], [-45.0, 45.0]]), ACROSS) == pytest.approx(
        math.degrees(math.atan(0.5))
    )


def test_a_back_and_a_whole_trunk_have_the_same_numbers() -> None:
    case = whole_phantom()
    back, whole = measure_back(case.skin, case.landmarks_before), measure(case.skin, case.landmarks_before)
    levels = {level: not_none(at) for level, at in back.levels.items()}
    assert {level: at.rotation for level, at in levels.items()} == pytest.approx(whole.bsr, abs=1e-9)
    assert {level: at.slope for level, at in levels.items()} == pytest.approx(whole.slopes, abs=1e-9)


def test_the_forward_bend_is_the_standing_slope_and_beside_it_that_of_three_levels() -> None:
    standing = {"T8": 1.0, "T9": 2.0, "T10": 4.0, "T11": 9.0, "T12": 8.0, "L1": 5.0, "L2": 2.0, "L3": None}
    assert forward_bend(standing) == {"T9": 5.0, "T10": 7.0, "T11": 9.0, "T12": 8.0, "L1": 5.0, "L2": 2.0}
    assert forward_bend(standing | {"L2": None})["L1"] is None


def test_trunk_length_is_the_height_of_t1_over_the_iliac_spines() -> None:
    """Nothing changes where both iliac spines tilt about their middle."""
    case = whole_phantom()
    marks = case.landmarks_before
    length = marks.point("T1_superior_endplate")[2] - marks.point("asis_left")[2]
    tilted = marks.points.copy()
    tilted[[marks.index("asis_left"), marks.index("asis_right")], 2] += [8.0, -8.0]
    for points in (marks.points, tilted):
        measures = measure(case.skin, Landmarks(marks.names, points))
        table = MeasureTable.of({"before": measures})
        assert table.value("before", "trunk_length_mm") == pytest.approx(length)
        assert table.value("before", "t1_tilt_deg") == measures.tilts["T1"]


def test_the_report_names_the_forward_bend_with_its_interval() -> None:
    """Where it shows most before: at T11 left, of patients 7 or 12 +- 1.96 * 4.5; 9 is more than 7 says."""

    def words(after: float, before: float = -20.0) -> str:
        rows = [
            Measured(state, level, "forward_bend_deg", value)
            for state, values in (("before", {"T11": before, "L1": 5.0}), ("predicted", {"T11": after, "L1": 9.0}))
            for level, value in values.items()
        ]
        return bent(MeasureTable(rows))

    assert "at T11 in the forward bend would show about 12° left instead of 20° left" in words(-12.0)
    assert words(-12.0).endswith(": 21° left to 3.2° left in 95 % of patients.")
    assert words(-7.0).endswith("about 7.0° left instead of 20° left: 16° left to 1.8° right in 95 % of patients.")
    assert "would show in the forward bend is not known, 12° left before" in words(-7.0, -12.0)
    assert bent(MeasureTable([])) == ""
