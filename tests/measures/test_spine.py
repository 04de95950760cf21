"""Balance in the sagittal plane, height of the spine and of the shoulders, each against lengths that are known."""

from dataclasses import replace

import numpy as np
import pytest

from support.asserting import there
from support.known_spine import BODY, DISC, known_spine
from support.trunk_shapes import ASIS, ellipse, spine, tube, with_points
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import measure
from warp_trunk.measures.cobb import spine_height
from warp_trunk.measures.outlines import INNER, OUTER, shoulder_heights
from warp_trunk.measures.spine import TrunkShift, sacral_line, spine_of, trunk_shift

LEFT = np.array([1.0, 0.0])


def shift_of(landmarks):
    return trunk_shift(spine_of(landmarks), sacral_line(landmarks))


def test_spine_that_leans_forward_stands_in_front_of_the_sacrum():
    """17 vertebrae and 16 discs at 10 degrees; T1's centroid is 10 mm below its top, its pedicles 15 behind."""
    leaning = known_spine(back={"T1": -10.0, "L5": -10.0})
    length = (17 * BODY + 16 * DISC) - 0.5 * BODY
    expected = length * np.sin(np.radians(10.0)) - 4.0 / 6.0 * 15.0
    shift = there(shift_of(leaning))
    assert (shift.lateral, shift.forward) == pytest.approx((0.0, expected), abs=1e-9)
    assert (shift.upper, shift.lower) == ("T1", "L5")


def test_height_is_that_of_the_stack_and_shrinks_with_the_cosine_of_a_tilt():
    length = 17 * BODY + 16 * DISC
    upright = there(spine_height(spine_of(known_spine())))
    assert (upright.upper, upright.lower) == ("T1", "L5")
    assert upright.height == pytest.approx(length)
    tilted = there(spine_height(spine_of(known_spine(to_left={"T1": 20.0, "L5": 20.0}))))
    assert tilted.height == pytest.approx(length * np.cos(np.radians(20.0)), abs=1e-9)


def test_height_reaches_s1_where_it_is_known_and_needs_t1():
    landmarks = with_points(known_spine(), {"S1_superior_endplate": (0.0, 40.0, -50.0)})
    found = there(spine_height(spine_of(landmarks)))
    assert (found.upper, found.lower) == ("T1", "S1")
    assert found.height == pytest.approx(450.0)
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
    found = there(shoulder_heights(roof(0.4, higher), spine_of(known_spine()), LEFT))
    assert found.difference == pytest.approx(higher, abs=1e-9)
    middle = 420.0 - 0.4 * (0.5 * (INNER + OUTER) * 150.0 - 55.0) - 390.0  # T1's centroid is at 390
    assert found.left == pytest.approx(middle, abs=1e-9)


LEVELS = {"T1": 380.0, "T8": 240.0, "L5": 80.0}


def sheared_spine(aside, levels=LEVELS):
    """Its top moved aside by a length [mm] against its bottom, evenly in between."""
    straight = spine(levels, (0.0, 40.0))
    points = straight.points.copy()
    bone = [not name.startswith("asis") for name in straight.names]
    points[bone, 0] += aside * (points[bone, 2] - 70.0) / (380.0 - 70.0)
    return Landmarks(straight.names, points)


def rounded_shift(landmarks: Landmarks) -> TrunkShift:
    """Lateral to a millionth of a millimetre."""
    found = there(measure(tube(ellipse()), landmarks).trunk_shift)
    return replace(found, lateral=round(found.lateral, 6))


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
    measures = measure(Surface(vertices, straight.faces), spine(LEVELS, (0.0, 0.0)))
    expected = {"T1": 30.0, "T8": 16.0, "L5": 0.0}
    for level, offset in expected.items():
        flanks = there(measures.flanks[level])
        assert (flanks.left, flanks.right) == pytest.approx((100.0 - offset, 100.0 + offset), abs=0.01)
        assert flanks.index == pytest.approx(offset, abs=0.01)
