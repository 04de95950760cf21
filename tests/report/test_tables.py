"""What tables and sentences say of spines whose angles are known: left and right, one curve and two."""

import pytest

from support.known_spine import known_spine
from support.trunk_shapes import flat_back, rotation, tube
from warp_trunk.measures import measure
from warp_trunk.report.curves import curve_changes, main_curves
from warp_trunk.report.sentences import glance, sentences
from warp_trunk.report.style import BEFORE, PREDICTED, Pose
from warp_trunk.report.tables import measure_rows, rotation_rows, sided, size_change

THORACIC = {"T1": -10.0, "T5": 30.0, "T12": -30.0, "L4": 0.0}
DOUBLE = {"T1": 28.0, "T4": 30.0, "T11": -30.0, "L4": 28.0}


def scaled(angles, share):
    return {level: share * angle for level, angle in angles.items()}


def pose(look, spine, turn=0.0):
    """A trunk with a flat back, turned clockwise seen from above, and its spine."""
    skin = tube(flat_back() @ rotation(-turn).T, bottom=-80.0, top=440.0)
    return Pose(look, skin, spine, measure(skin, spine))


def poses(before, planned, turned=(12.0, 4.0), **options):
    return [
        pose(BEFORE, known_spine(to_left=before, **options), turned[0]),
        pose(PREDICTED, known_spine(to_left=planned, **options), turned[1]),
    ]


def test_left_curve_and_left_hump_that_improve_are_told_as_less():
    """Mirrored, a thoracic 60 with its hump on the left: sizes fall, and no change is printed as more."""
    left = poses(scaled(THORACIC, -1.0), scaled(THORACIC, -0.3), turned=(-12.0, -4.0))
    rows = {row[0]: row[1:] for row in measure_rows(left) if len(row) > 1}
    assert rows["Back surface rotation (BSR), largest from T1 to T12 [°]"] == ["12.0 left", "4.0 left", "−8.0"]
    for name, cells in rows.items():
        if name.startswith(("Back surface", "Hump", "Cobb")):
            assert cells[2].startswith("−"), name
    assert all(row[3].startswith("−") for row in rotation_rows(left))
    assert "left side of the back still stands out, by 4 degrees" in sentences(left, None)["What stays"]


def test_a_hump_that_changes_its_side_is_told_with_its_sides():
    stays = sentences(poses(THORACIC, THORACIC, turned=(-12.0, 4.0)), None)["What stays"]
    assert "right side of the back then stands out, by 4 degrees" in stays
    assert "the largest hump is " in stays
    assert stays.index("(right)") < stays.index("where it was") < stays.index("(left)")


def test_every_curve_has_its_rows_told_of_the_same_vertebrae():
    both = poses(THORACIC, scaled(THORACIC, 0.3))
    headings = [row[0] for row in measure_rows(both) if len(row) == 1]
    assert [name.split(",")[0] for name in headings if name.startswith("Curve")] == [
        "Curve T1 to T5", "Curve T5 to T12", "Curve T12 to L4",
    ]  # fmt: skip
    cobb = [row[1:] for row in measure_rows(both) if row[0].startswith("Cobb")]
    assert cobb == [["40.0", "12.0", "−28.0"], ["60.0", "18.0", "−42.0"], ["30.0", "9.0", "−21.0"]]


def test_overcorrected_curve_is_below_zero():
    rows = measure_rows(poses(THORACIC, scaled(THORACIC, -0.1)))
    assert [row[2] for row in rows if row[0].startswith("Cobb")] == ["−4.0", "−6.0", "−3.0"]


def test_double_major_is_told_by_both_its_curves():
    both = poses(DOUBLE, scaled(DOUBLE, 0.5))
    told = sentences(both, None)
    assert "straighten the main curves of the spine" in told["What is planned"]
    assert (
        "from 60 to 30 (T4 to T11, to the right) and from 58 to 29 (T11 to L4, to the left)"
        in told["What is planned"]
    )
    assert "in the lower back by 4 instead of 12" in told["What changes"]
    assert [value for _, value in glance(both)[:2]] == ["60° → 30°", "58° → 29°"]
    assert [curve.before.upper for curve in main_curves(curve_changes(*both))] == ["T4", "T11"]


def test_single_curve_has_smaller_ones_beside_it():
    told = sentences(poses(THORACIC, scaled(THORACIC, 0.3)), None)["What is planned"]
    assert "straighten the main curve of the spine from 60 to 18 (T5 to T12, to the right)" in told
    assert "the smaller ones from 40 to 12 (T1 to T5, to the left) and from 30 to 9" in told


def test_plan_that_makes_a_curve_larger_does_not_straighten():
    told = sentences(poses(THORACIC, scaled(THORACIC, 1.2)), None)["What is planned"]
    assert "is planned to change the main curve" in told


def test_sagittal_measures_and_height_stand_in_the_table():
    back = {"T1": -20.0, "T12": 15.0, "L5": -20.0}
    both = poses(THORACIC, scaled(THORACIC, 0.3), back=back)
    rows = {row[0]: row[1:] for row in measure_rows(both) if len(row) > 1}
    assert rows["Kyphosis T1 to T12 [°]"] == ["35.0", "35.0", "0.0"]
    assert "Lordosis L1 to S1 [°]" not in rows
    gained = float(rows["Height of the spine [mm]"][2])
    assert gained > 5.0
    assert f"the spine stands {gained:.0f} mm taller" in sentences(both, None)["What changes"].lower()
    assert ("height of the spine", f"+{gained:.0f} mm") in glance(both)


@pytest.mark.parametrize(
    ("value", "text"), [(12.24, "12.2 right"), (-0.04, "0.0"), (-3.0, "3.0 left"), (None, "–")]
)
def test_sides_are_words(value, text):
    assert sided(value) == text


def test_change_is_that_of_the_size_also_where_the_side_changes():
    assert size_change(-20.0, 3.0) == pytest.approx(-17.0)
    assert size_change(None, 3.0) is None
