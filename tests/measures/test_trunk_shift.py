"""Trunk shift and flanks of trunks that are moved aside by known lengths."""

from dataclasses import replace

import pytest

from support.there import there
from support.trunk_shapes import ASIS, ellipse, spine, tube, with_points
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import measure
from warp_trunk.measures.spine import TrunkShift

LEVELS = {"T1": 380.0, "T8": 240.0, "L5": 80.0}


def sheared_spine(aside, levels=LEVELS):
    """Its top moved aside by a length [mm] against its bottom, evenly in between."""
    straight = spine(levels, (0.0, 40.0))
    points = straight.points.copy()
    bone = [not name.startswith("asis") for name in straight.names]
    points[bone, 0] += aside * (points[bone, 2] - 70.0) / (380.0 - 70.0)
    return Landmarks(straight.names, points)


def shift_of(landmarks: Landmarks) -> TrunkShift:
    """Lateral to a millionth of a millimetre."""
    found = there(measure(tube(ellipse()), landmarks).trunk_shift)
    return replace(found, lateral=round(found.lateral, 6))


@pytest.mark.parametrize(("aside", "expected"), [(-25.0, 25.0), (10.0, -10.0)])
def test_shear_of_the_spine_is_its_shift_positive_to_the_right(aside, expected):
    """The lower endplate of L5 is at 70 mm, where the shear begins."""
    shift = shift_of(sheared_spine(aside))
    assert shift == TrunkShift(expected, 0.0, "T1", "L5")


def test_best_landmarks_at_hand_are_used():
    landmarks = sheared_spine(0.0)
    sacrum = {"sacrum_left": (7.0, 50.0, 40.0), "sacrum_right": (-3.0, 50.0, 40.0)}
    s1 = {"S1_superior_endplate": (4.0, 40.0, 60.0), "S1_left": (90.0, 40.0, 60.0)}
    c7 = {"C7_spinous_process": (-6.0, 60.0, 400.0)}
    assert shift_of(with_points(landmarks, sacrum)) == TrunkShift(2.0, 10.0, "T1", "sacrum")
    assert shift_of(with_points(landmarks, sacrum | s1)) == TrunkShift(4.0, 0.0, "T1", "S1")
    assert shift_of(with_points(landmarks, s1 | c7)) == TrunkShift(10.0, -20.0, "C7", "S1")


def test_without_a_sacrum_the_middle_of_the_pelvis_serves():
    asis = [(x + 9.0, y) for x, y in ASIS]
    landmarks = spine({"T1": 380.0, "L4": 120.0}, (0.0, 40.0), asis)
    assert shift_of(landmarks) == TrunkShift(9.0, None, "T1", "pelvis")


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
