"""Cobb angles of spines that are built from their tilts."""

import pytest

from support.known_spine import LEVELS, known_spine
from warp_trunk.measures import cobb_angles


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
