"""Cobb angles, kyphosis and lordosis of spines that are built from their tilts."""

import numpy as np
import pytest

from support.known_spine import LEVELS, known_spine
from support.trunk_shapes import with_points
from warp_trunk.measures import cobb_angles
from warp_trunk.measures.cobb import kyphosis, lordosis
from warp_trunk.measures.spine import spine_of


def test_straight_spine_has_no_curve():
    assert cobb_angles(known_spine()) == ()


def test_single_curve_is_found_between_its_end_vertebrae():
    """Going down from T5 leaning left to T12 leaning right, the spine runs to the right, then back."""
    tilts = {"T1": 21.0, "T5": 25.0, "T12": -30.0, "L5": -22.0}
    (curve,) = cobb_angles(known_spine(to_left=tilts, turned={"T8": 17.0}))
    assert curve.angle == pytest.approx(55.0, abs=1e-9)
    assert (curve.upper, curve.lower) == ("T5", "T12")
    assert curve.apex in {"T8", "T9"}
    assert curve.convex == "right"


def test_double_major_gives_two_curves_with_opposite_sides():
    tilts = {"T1": -12.0, "T5": -20.0, "T11": 25.0, "L4": -15.0, "L5": -13.0}
    thoracic, lumbar = cobb_angles(known_spine(to_left=tilts))
    assert thoracic.angle == pytest.approx(45.0)
    assert lumbar.angle == pytest.approx(40.0)
    assert (thoracic.upper, thoracic.lower, lumbar.upper, lumbar.lower) == ("T5", "T11", "T11", "L4")
    assert (thoracic.convex, lumbar.convex) == ("left", "right")


def test_unevenness_below_ten_degrees_is_no_curve_and_splits_none():
    wiggle = {level: 4.0 * (-1.0) ** row for row, level in enumerate(LEVELS)}
    assert cobb_angles(known_spine(to_left=wiggle)) == ()
    even = {level: 30.0 - 60.0 * row / 16.0 + 0.5 * wiggle[level] for row, level in enumerate(LEVELS)}
    (curve,) = cobb_angles(known_spine(to_left=even))
    assert curve.angle == pytest.approx(60.0, abs=2.0)


ROUND = {"T1": -24.0, "T5": -18.0, "T12": 14.0, "L1": 15.0, "L5": -22.0}
"""Tilt backwards by level: forward at the top, back at the thoracolumbar junction, forward at the bottom."""


def angles(landmarks):
    spine = spine_of(landmarks)
    return {**kyphosis(spine), **lordosis(spine)}


def test_angles_are_those_between_the_axes_it_was_built_with():
    found = angles(known_spine(back=ROUND))
    assert found["T1-T12"] == pytest.approx(38.0, abs=1e-9)
    assert found["T5-T12"] == pytest.approx(32.0, abs=1e-9)
    assert found["L1-L5"] == pytest.approx(37.0, abs=1e-9)


def test_scoliosis_and_axial_rotation_change_nothing_seen_from_the_side():
    curved = known_spine(
        to_left={"T1": 10.0, "T5": 30.0, "T12": -30.0, "L5": 0.0}, back=ROUND, turned={"T8": 25.0, "L2": -10.0}
    )
    plain = angles(known_spine(back=ROUND))
    assert angles(curved) == pytest.approx({**plain, "L1-S1": None}, abs=1e-9)


@pytest.mark.parametrize("bone", ["S1", "sacrum"])
def test_lordosis_reaches_the_sacrum_where_it_has_landmarks(bone):
    """The axis of S1 leans forward by 40 degrees; that of L1 leans back by 15."""
    lean = np.radians(40.0)
    upper = np.array([0.0, 45.0, -60.0])
    lower = upper - 20.0 * np.array([0.0, -np.sin(lean), np.cos(lean)])
    points = {f"{bone}_superior_endplate": upper, f"{bone}_inferior_endplate": lower}
    found = angles(with_points(known_spine(back=ROUND), points))
    assert found["L1-S1"] == pytest.approx(55.0, abs=1e-9)
    assert found["L1-L5"] == pytest.approx(37.0, abs=1e-9)
