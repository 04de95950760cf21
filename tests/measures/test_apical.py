"""Axial rotation of vertebrae turned by known angles, and the apical vertebra of curves that are known."""

import math

import numpy as np
import pytest

from support.asserting import there
from support.known_spine import BODY, DISC, LEVELS, known_spine
from support.trunk_shapes import LEFT, ellipse, rotation, spine, tube, with_points
from warp_trunk.measures import curves_after, measure
from warp_trunk.measures.apical import axial_rotation
from warp_trunk.measures.spine import spine_of

THORACIC = {"T1": 0.0, "T4": 30.0, "T12": -30.0, "L3": 0.0, "L5": 0.0}
TURNED = {"T1": 0.0, "T4": -1.0, "T8": 20.0, "L1": 1.0, "L3": -6.0, "L5": 0.0}
DOUBLE = {"T1": 22.0, "T5": 25.0, "T11": -25.0, "L4": 25.0, "L5": 20.0}


def measured(landmarks):
    return measure(tube(ellipse(), bottom=-200.0, top=500.0), landmarks)


def aside_of(tilts, level):
    """How far left of the first upper endplate the middle of a vertebra lies, added up from the tilts [mm]."""
    angles = np.radians(np.interp(range(17), [LEVELS.index(name) for name in tilts], list(tilts.values())))
    steps = (BODY + DISC) * np.sin(angles)
    last = LEVELS.index(level)
    return -(steps[:last].sum() + 0.5 * BODY * math.sin(angles[last]))


def test_apex_of_a_thoracic_curve_is_measured_from_the_plumb_line_of_t1():
    landmarks = known_spine(to_left=THORACIC, turned=TURNED)
    measures = measured(landmarks)
    number = next(i for i, curve in enumerate(measures.cobb) if curve.upper == "T4")
    apex = measures.apices[number]
    assert apex.level == measures.cobb[number].apex == "T8"
    assert apex.rotation == pytest.approx(20.0, abs=1e-9)
    # centroids hold the pedicles, which lie behind the body and, where the vertebra is turned, beside it
    pedicles = 4.0 / 6.0 * 15.0 * math.sin(math.radians(20.0))
    expected = aside_of(THORACIC, "T8") + pedicles - aside_of(THORACIC, "T1")
    assert apex.translation == pytest.approx(-expected, abs=1e-9)
    assert apex.line == "T1"
    assert (apex.neutral_above, apex.neutral_below) == ("T4", "L1")


def test_apex_of_a_lumbar_curve_is_measured_from_the_sacral_line():
    landmarks = known_spine(to_left=DOUBLE)
    thoracic, lumbar = measured(landmarks).apices
    (s1,) = [apex for apex in measured(with_points(landmarks, {"S1_superior_endplate": (9.0, 40.0, -60.0)})).apices
             if apex.level == lumbar.level]  # fmt: skip
    assert (thoracic.line, lumbar.line, s1.line) == ("T1", "L5", "S1")
    middle = landmarks.of_bone(lumbar.level).points.mean(axis=0)[0]
    assert lumbar.translation == pytest.approx(landmarks.point("L5_inferior_endplate")[0] - middle, abs=1e-9)
    assert s1.translation == pytest.approx(9.0 - middle, abs=1e-9)
    assert there(lumbar.translation) < -5.0  # to the left, where the curve bulges


def test_neutral_vertebra_is_the_one_turned_least_where_none_turns_back():
    turned = {"T1": 4.0, "T3": 3.0, "T8": 20.0, "L2": 2.0, "L5": 6.0}
    tilts = {"T1": 28.0, "T4": 30.0, "T12": -30.0, "L5": -28.0}  # one curve, so nothing ends the search
    (apex,) = measured(known_spine(to_left=tilts, turned=turned)).apices
    assert (apex.neutral_above, apex.neutral_below) == ("T3", "L2")


def test_curve_is_followed_between_the_end_vertebrae_it_had():
    """T4 to T12 from 60 to 20 degrees, while the largest tilts after are those of T6 and T10; then beyond 0."""
    curves = measured(known_spine(to_left=THORACIC)).cobb
    number = next(i for i, curve in enumerate(curves) if curve.upper == "T4")
    assert (curves[number].lower, curves[number].convex) == ("T12", "right")
    after = known_spine(to_left={"T4": 10.0, "T6": 16.0, "T10": -16.0, "T12": -10.0})
    assert curves_after(curves, after)[number] == pytest.approx(20.0, abs=1e-9)
    beyond = known_spine(to_left={"T4": -3.0, "T12": 4.0})
    assert curves_after(curves, beyond)[number] == pytest.approx(-7.0, abs=1e-9)


def pedicles(level, degrees, tilt=0.0, centre=(5.0, 40.0, 200.0)):
    """Pedicles 30 mm apart, turned clockwise seen from above, in a vertebra that leans to the left."""
    c, s = math.cos(math.radians(tilt)), math.sin(math.radians(tilt))
    lean = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    turn = np.eye(3)
    turn[:2, :2] = rotation(-degrees)
    return {
        f"{level}_{side}_pedicle_{end}": np.array(centre) + lean @ turn @ np.array([x, 8.0, z])
        for side, x in (("left", 15.0), ("right", -15.0))
        for end, z in (("superior", 5.0), ("inferior", -5.0))
    }


@pytest.mark.parametrize("degrees", [0.0, 17.0, -23.0, 60.0])
def test_vertebra_turned_by_an_angle_has_it(degrees):
    turned = spine_of(with_points(spine({}), pedicles("T8", degrees)))
    assert axial_rotation(turned, LEFT)["T8"] == pytest.approx(degrees, abs=1e-9)


def test_leaning_aside_is_no_rotation():
    leaning = spine_of(with_points(spine({}), pedicles("T8", 0.0, tilt=35.0)))
    assert axial_rotation(leaning, LEFT)["T8"] == pytest.approx(0.0, abs=1e-9)
