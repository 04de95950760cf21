"""Balance, height, shoulders, apical rotation, Cobb angles and waist, of spines and trunks that are known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from support.asserting import not_none
from support.known_spine import BODY, DISC, LEVELS, known_spine
from support.synthetic import grid_faces
from support.trunk_shapes import ASIS, LEFT, ellipse, rotation, spine, tube, with_points
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import measure
from warp_trunk.measures.outlines import INNER, OUTER, Silhouette, hollows, shoulder_heights
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


def test_height_is_that_of_the_stack_and_shrinks_with_the_cosine_of_a_tilt():
    length = 17 * BODY + 16 * DISC
    upright = not_none(spine_height(spine_of(known_spine())))
    assert (upright.upper, upright.lower) == ("T1", "L5")
    assert upright.height == pytest.approx(length)
    tilted = not_none(spine_height(spine_of(known_spine(to_left={"T1": 20.0, "L5": 20.0}))))
    assert tilted.height == pytest.approx(length * np.cos(np.radians(20.0)), abs=1e-9)


def test_height_reaches_s1_where_it_is_known_and_needs_t1():
    landmarks = with_points(known_spine(), {"S1_superior_endplate": (0.0, 40.0, -50.0)})
    height_of_spine = not_none(spine_height(spine_of(landmarks)))
    assert (height_of_spine.upper, height_of_spine.lower) == ("T1", "S1")
    assert height_of_spine.height == pytest.approx(450.0)
    assert spine_height(spine_of(known_spine(levels=("T2", "T3", "L5")))) is None


def roof(slope, higher=0.0, aside=0.0, neck=55.0):
    """A closed trunk 300 mm wide whose top falls from the neck to both sides; the right half is higher [mm]."""
    x = np.unique(np.concatenate([np.linspace(-150.0, 150.0, 61), [-neck, neck]]))
    top = 420.0 - slope * np.maximum(np.abs(x) - neck, 0.0) + higher * (x < -neck)
    ring = np.concatenate([np.column_stack([x, top]), np.column_stack([x[::-1], np.zeros(len(x))])])
    n = len(ring)
    vertices = np.concatenate(
        [np.column_stack([ring[:, 0] + aside, np.full(n, y), ring[:, 1]]) for y in (-80, 80)]
    )
    i = np.arange(n)
    j = np.roll(i, -1)
    side = np.concatenate([np.column_stack([i, j, j + n]), np.column_stack([i, j + n, i + n])])
    k = np.arange(len(x) - 1)
    cap = np.concatenate([np.column_stack([k, n - 2 - k, k + 1]), np.column_stack([k, n - 1 - k, n - 2 - k])])
    return Surface(vertices, np.concatenate([side, cap, cap[:, ::-1] + n]).astype(np.int32))


@pytest.mark.parametrize("higher", [18.0, -7.0, 0.0])
def test_shoulder_that_is_raised_by_a_length_stands_higher_by_it(higher):
    shoulders = not_none(shoulder_heights(roof(0.4, higher), spine_of(known_spine()), LEFT))
    assert shoulders.difference == pytest.approx(higher, abs=1e-9)
    middle = 420.0 - 0.4 * (0.5 * (INNER + OUTER) * 150.0 - 55.0) - 390.0  # T1's centroid is at 390
    assert shoulders.left == pytest.approx(middle, abs=1e-9)
    wide = (INNER + OUTER) * 150.0
    assert shoulders.angle == pytest.approx(math.degrees(math.atan2(higher, wide)), abs=1e-9)


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


def test_flanks_of_a_sheared_cylinder():
    """A cylinder of 100 mm radius whose axis leans to the right by 30 mm between L5 and T1."""
    straight = tube(ellipse(720, 100.0, 100.0))
    vertices = straight.vertices.copy()
    vertices[:, 0] -= 30.0 * (vertices[:, 2] - 80.0) / 300.0
    measures = measure(Surface(vertices, straight.faces), spine(PLACES, (0.0, 0.0)))
    expected = {"T1": 30.0, "T8": 16.0, "L5": 0.0}
    for level, offset in expected.items():
        flanks = not_none(measures.flanks[level])
        assert (flanks.left, flanks.right) == pytest.approx((100.0 - offset, 100.0 + offset), abs=0.01)
        assert flanks.index == pytest.approx(offset, abs=0.01)


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
    kyphosis = angles(known_spine(back=ROUND))
    assert kyphosis["T1-T12"] == pytest.approx(38.0, abs=1e-9)
    assert kyphosis["T5-T12"] == pytest.approx(32.0, abs=1e-9)
    assert kyphosis["L1-L5"] == pytest.approx(37.0, abs=1e-9)


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
    lordosis = angles(with_points(known_spine(back=ROUND), points))
    assert lordosis["L1-S1"] == pytest.approx(55.0, abs=1e-9)
    assert lordosis["L1-L5"] == pytest.approx(37.0, abs=1e-9)


HEIGHTS = np.linspace(-80.0, 440.0, 131)


def trunk(depths, places):
    """A tube, 300 mm wide, with a triangular notch of 120 mm, of some depth and height on each side."""
    around = np.radians(np.arange(0, 360, 5))
    notch = [d * np.clip(1.0 - np.abs(HEIGHTS - z) / 60.0, 0.0, 1.0) for d, z in zip(depths, places, strict=True)]
    left, right = (150.0 - depth for depth in notch)
    x = np.where(np.cos(around) > 0.0, left[:, None], right[:, None]) * np.cos(around)
    y = np.broadcast_to(100.0 * np.sin(around), x.shape)
    points = np.stack([x, y, np.broadcast_to(HEIGHTS[:, None], x.shape)], axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(x.shape)
    low, high = number[0], number[-1]
    ends = [np.stack(np.broadcast_arrays(len(points) + k, *pair), axis=-1) for k, pair in enumerate(
        ((np.roll(low, -1), low), (high, np.roll(high, -1)))
    )]  # fmt: skip
    tips = [[0.0, 0.0, HEIGHTS[0]], [0.0, 0.0, HEIGHTS[-1]]]
    return Surface(
        np.concatenate([points, tips]), np.concatenate([grid_faces(*x.shape, closed=True), *ends]).astype(np.int32)
    )


def test_depth_and_height_of_each_side_are_those_of_its_notch():
    spine = known_spine()
    pelvis = 0.5 * (spine.point("asis_left") + spine.point("asis_right"))[2]
    waist = not_none(measure(trunk((30.0, 12.0), (pelvis + 60.0, pelvis + 84.0)), spine).waist)
    assert (waist.left_depth, waist.right_depth) == pytest.approx((30.0, 12.0), abs=2.1)  # heights are 8 mm apart
    assert waist.left_height == pytest.approx(60.0, abs=4.0)
    assert waist.right_height == pytest.approx(84.0, abs=4.0)
    assert waist.height_difference == pytest.approx(24.0, abs=8.0)
    wide = 300.0 - 30.0 - 12.0
    assert waist.height_angle == pytest.approx(math.degrees(math.atan2(24.0, wide)), abs=1.8)
    angles = [2.0 * math.degrees(math.atan2(60.0, depth)) for depth in (waist.left_depth, waist.right_depth)]
    assert (waist.left_angle, waist.right_angle) == pytest.approx(angles, abs=3.0)
    assert waist.angle_ratio == pytest.approx(100.0 * waist.right_angle / waist.left_angle)
    assert waist.angle_ratio > 110.0
    assert waist.depth_ratio == pytest.approx(100.0 * 30.0 / 12.0, rel=0.2)
    mirrored = not_none(measure(trunk((12.0, 30.0), (pelvis + 84.0, pelvis + 60.0)), spine).waist)
    assert mirrored.height_angle == pytest.approx(-waist.height_angle, abs=1e-6)
    assert mirrored.angle_ratio * waist.angle_ratio == pytest.approx(1e4)
    assert mirrored.depth_difference == pytest.approx(-waist.depth_difference, abs=1e-6)


def test_a_hollow_of_the_chest_is_no_waist():
    """The left side is hollow above the height that ends the waist, by more than the right one is below it."""
    heights = np.arange(0.0, 300.0, 8.0)
    left, right = (
        150.0 - depth * np.clip(1.0 - np.abs(heights - z) / 40.0, 0.0, 1.0)
        for depth, z in ((30.0, 232.0), (12.0, 104.0))
    )
    outline = Silhouette(heights, np.stack([left, right]), np.zeros((2, len(heights), 2), int), 40.0, 180.0)
    waist = hollows(outline)
    assert (waist.left_depth, waist.right_depth) == pytest.approx((0.0, 12.0), abs=1e-9)
    assert (waist.left_height, waist.right_height) == pytest.approx((0.0, 64.0), abs=1e-9)


def test_straight_flanks_have_no_waist_and_a_spine_without_t8_no_measure():
    spine = known_spine()
    measured = not_none(measure(trunk((0.0, 0.0), (100.0, 100.0)), spine).waist)
    assert (measured.left_depth, measured.right_depth) == pytest.approx((0.0, 0.0), abs=1e-6)
