"""Balance, height, shoulders, apical rotation, Cobb angles and waist, of spines and trunks that are known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.asserting import not_none
from support.known_spine import BODY, DISC, LEVELS, known_spine
from support.trunk_shapes import ASIS, LEFT, ellipse, spine, tube, with_points
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.measures import measure
from warp_trunk.measures.outlines import Silhouette, hollows, silhouette_of
from warp_trunk.spine import CobbAngle, cobb_angles, curves_after
from warp_trunk.spine.apical import apical_vertebrae, axial_rotation
from warp_trunk.spine.cobb import kyphosis, lordosis, spine_height
from warp_trunk.spine.spine import TrunkShift, sacral_line, spine_of, trunk_shift


def shift_of(landmarks):
    return trunk_shift(spine_of(landmarks), sacral_line(landmarks))


def test_spine_that_leans_forward_stands_in_front_of_the_sacrum():
    """17 vertebrae and 16 discs at 10 degrees; T1's centroid is 10 mm below its top, its pedicles 15 behind."""
    leaning = known_spine(back={"T1": -10.0, "L5": -10.0})
    length = (17 * BODY + 16 * DISC) - 0.5 * BODY
    expected = length * np.sin(np.radians(10.0)) - 4.0 / 6.0 * 15.0
    shift = not_none(shift_of(leaning))
    assert (shift.lateral, shift.forward) == pytest.approx((0.0, expected), abs=1e-9)
    assert (shift.upper, shift.lower) == ("T1", "L5")


def test_height_reaches_s1_where_it_is_known_and_needs_t1():
    landmarks = with_points(known_spine(), {"S1_superior_endplate": (0.0, 40.0, -50.0)})
    height_of_spine = not_none(spine_height(spine_of(landmarks)))
    assert (height_of_spine.upper, height_of_spine.lower) == ("T1", "S1")
    assert height_of_spine.height == pytest.approx(450.0)
    assert spine_height(spine_of(known_spine(levels=("T2", "T3", "L5")))) is None


PLACES = {"T1": 380.0, "T8": 240.0, "L5": 80.0}


def sheared_spine(aside, levels=PLACES):
    """Its top moved aside by a length [mm] against its bottom, evenly in between."""
    straight = spine(levels, (0.0, 40.0))
    points = straight.points.copy()
    bone = [not name.startswith("asis") for name in straight.names]
    points[bone, 0] += aside * (points[bone, 2] - 70.0) / (380.0 - 70.0)
    return Landmarks(straight.names, points)


def rounded_shift(landmarks: Landmarks) -> TrunkShift:
    """Lateral to a millionth of a millimetre."""
    shift = not_none(measure(tube(ellipse()), landmarks).trunk_shift)
    return replace(shift, lateral=round(shift.lateral, 6))


@pytest.mark.parametrize(("aside", "expected"), [(-25.0, 25.0), (10.0, -10.0)])
def test_shear_of_the_spine_is_its_shift_positive_to_the_right(aside, expected):
    """The lower endplate of L5 is at 70 mm, where the shear begins."""
    shift = rounded_shift(sheared_spine(aside))
    assert shift == TrunkShift(expected, 0.0, "T1", "L5")


def test_best_landmarks_at_hand_are_used():
    landmarks = sheared_spine(0.0)
    sacrum = {"sacrum_left": (7.0, 50.0, 40.0), "sacrum_right": (-3.0, 50.0, 40.0)}
    s1 = {"S1_superior_endplate": (4.0, 40.0, 60.0), "S1_left": (90.0, 40.0, 60.0)}
    c7 = {"C7_spinous_process": (-6.0, 60.0, 400.0)}
    assert rounded_shift(with_points(landmarks, sacrum)) == TrunkShift(2.0, 10.0, "T1", "sacrum")
    assert rounded_shift(with_points(landmarks, sacrum | s1)) == TrunkShift(4.0, 0.0, "T1", "S1")
    assert rounded_shift(with_points(landmarks, s1 | c7)) == TrunkShift(10.0, -20.0, "C7", "S1")


def test_without_a_sacrum_the_middle_of_the_pelvis_serves():
    asis = [(x + 9.0, y) for x, y in ASIS]
    landmarks = spine({"T1": 380.0, "L4": 120.0}, (0.0, 40.0), asis)
    assert rounded_shift(landmarks) == TrunkShift(9.0, None, "T1", "pelvis")


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


@pytest.mark.parametrize(("level", "line"), [("T2", "T1"), ("T11", "T1"), ("T12", "L5"), ("L1", "L5")])
def test_the_last_thoracic_apex_with_a_plumb_line_is_t11(level, line):
    """T12 and L1 are apices of thoracolumbar curves (Radiographic Measurement Manual)."""
    landmarks = known_spine(to_left={"T1": 9.0, "T6": 14.0, "L5": -20.0})
    spine, curve = spine_of(landmarks), CobbAngle(30.0, "T1", "L3", level, "right")
    (apex,) = apical_vertebrae(spine, [curve], dict.fromkeys(LEVELS, 0.0), sacral_line(landmarks))
    centre, top = (landmarks.of_bone(name).points.mean(axis=0)[0] for name in (level, "T1"))
    from_line = {"T1": top, "L5": landmarks.point("L5_inferior_endplate")[0]}[line]
    assert (apex.line, apex.translation) == (line, pytest.approx(from_line - centre, abs=1e-9))


def test_apex_of_a_lumbar_curve_is_measured_from_the_sacral_line():
    landmarks = known_spine(to_left=DOUBLE)
    thoracic, lumbar = measured(landmarks).apices
    (s1,) = [apex for apex in measured(with_points(landmarks, {"S1_superior_endplate": (9.0, 40.0, -60.0)})).apices
             if apex.level == lumbar.level]  # fmt: skip
    assert (thoracic.line, lumbar.line, s1.line) == ("T1", "L5", "S1")
    middle = landmarks.of_bone(lumbar.level).points.mean(axis=0)[0]
    assert lumbar.translation == pytest.approx(landmarks.point("L5_inferior_endplate")[0] - middle, abs=1e-9)
    assert s1.translation == pytest.approx(9.0 - middle, abs=1e-9)
    assert not_none(lumbar.translation) < -5.0  # to the left, where the curve bulges


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


@pytest.mark.parametrize(("degrees", "tilt"), [(17.0, 0.0), (-23.0, 0.0), (60.0, 0.0), (0.0, 35.0)])
def test_a_vertebra_has_its_rotation_and_none_where_it_leans(degrees, tilt):
    """Pedicles 30 mm apart, turned clockwise seen from above, in a vertebra that leans to the left."""
    to_world = Rotation.from_euler("zy", [-degrees, tilt], degrees=True)
    points = {
        f"T8_{side}_pedicle_{end}": np.array([5.0, 40.0, 200.0]) + to_world.apply([x, 8.0, z])
        for side, x in (("left", 15.0), ("right", -15.0))
        for end, z in (("superior", 5.0), ("inferior", -5.0))
    }
    turned = spine_of(with_points(spine({}), points))
    assert axial_rotation(turned, LEFT)["T8"] == pytest.approx(degrees, abs=1e-9)


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


@pytest.mark.parametrize("bone", ["S1", "sacrum"])
def test_lordosis_reaches_the_sacrum_where_it_has_landmarks(bone):
    """The axis of S1 leans forward by 40 degrees; that of L1 leans back by 15."""
    lean = np.radians(40.0)
    upper = np.array([0.0, 45.0, -60.0])
    lower = upper - 20.0 * np.array([0.0, -np.sin(lean), np.cos(lean)])
    points = {f"{bone}_superior_endplate": upper, f"{bone}_inferior_endplate": lower}
    lordosis = angles(with_points(known_spine(back=ROUND), points))
    assert lordosis["L1-S1"] == pytest.approx(55.0, abs=1e-9)
    assert lordosis["L1-L5"] == pytest.approx(37.0, abs=1e-9)


@pytest.mark.parametrize(
    ("deep", "heights_of_hollow"), [(12.0, (0.0, 64.0)), (1.5, (0.0, 64.0)), (1.0, (0.0, 0.0))]
)
def test_a_hollow_of_the_chest_is_no_waist_and_a_shallow_one_has_no_height(deep, heights_of_hollow):
    """The left side is hollow above the height that ends the waist, by more than the right one is below it."""
    heights = np.arange(0.0, 300.0, 8.0)
    left, right = (
        150.0 - depth * np.clip(1.0 - np.abs(heights - z) / 40.0, 0.0, 1.0)
        for depth, z in ((30.0, 232.0), (deep, 104.0))
    )
    outline = Silhouette(heights, np.stack([left, right]), np.zeros((2, len(heights), 2), int), 40.0, 180.0)
    waist = hollows(outline)
    assert (waist.left_depth, waist.right_depth) == pytest.approx((0.0, deep), abs=1e-9)
    assert (waist.left_height, waist.right_height) == pytest.approx(heights_of_hollow, abs=1e-9)


def test_a_silhouette_needs_five_heights() -> None:
    """From 40 mm below the iliac spines, at 20 mm, to T8, 8 mm apart."""
    for t8, measurable in ((19.9, True), (11.9, False)):
        marks = spine({"T8": t8, "T12": 15.0})
        outline = silhouette_of(tube(ellipse(), -300.0), spine_of(marks), sacral_line(marks), 20.0)
        assert (outline is not None) == measurable
