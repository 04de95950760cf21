"""Back surface rotation in sections that follow the shoulders."""

import math

import numpy as np
import pytest

from support.trunk_shapes import SPINE, flat_back, spine, tube
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures.back_rotation import back_surface_rotation
from warp_trunk.measures.shoulders import Shoulders
from warp_trunk.measures.upper_back import leaning_rotation, rotation_along_shoulders
from warp_trunk.preparation.phantom import straight_trunk

SKIN, _, LANDMARKS = straight_trunk()


def leaned(points: np.ndarray, degrees: float, about: float = 0.0) -> np.ndarray:
    """Points turned in the coronal plane so that the right side goes up, about a height [mm]."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    centre, turn = np.array([0.0, 0.0, about]), np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    return (points - centre) @ turn + centre


@pytest.mark.parametrize("lean", [-7.0, 5.0])
@pytest.mark.parametrize("back", [25.0, -15.0])
def test_a_leaning_back_seems_turned_in_a_horizontal_section_alone(back: float, lean: float) -> None:
    upright = tube(flat_back())
    x, y, z = upright.vertices.T
    y = np.where(y > 0.0, y - math.tan(math.radians(back)) * (z - 200.0), y)  # its back is inclined
    skin = Surface(leaned(np.column_stack([x, y, z]), lean, 200.0), upright.faces)
    landmarks = spine({"T1": 200.0}, SPINE)
    found = back_surface_rotation(skin, landmarks)["T1"]
    assert found is not None
    expected = math.degrees(math.atan(math.tan(math.radians(back)) * math.sin(math.radians(lean))))
    assert abs(expected) > 1.0
    assert found.angle == pytest.approx(expected, abs=1e-9)
    assert leaning_rotation(skin, landmarks, "T1", lean) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("lean", [-6.0, 0.0, 4.0])
def test_a_trunk_that_leans_as_one_keeps_its_rotation_in_sections_that_lean_with_it(lean: float) -> None:
    turned = SKIN.vertices.copy()
    turned[:, 1] -= 0.05 * turned[:, 0]  # the right side stands further back
    upright, skin = Surface(turned, SKIN.faces), Surface(leaned(turned, lean), SKIN.faces)
    landmarks = Landmarks(LANDMARKS.names, leaned(LANDMARKS.points, lean))
    for level in ("T1", "T2"):
        wanted = back_surface_rotation(upright, LANDMARKS)[level]
        assert wanted is not None
        assert wanted.angle > 2.0
        assert leaning_rotation(skin, landmarks, level, lean) == pytest.approx(wanted.angle, abs=1e-6)


def test_shoulders_slope_by_their_heights_over_the_way_between_them() -> None:
    assert Shoulders(left=10.0, right=30.0, inner=90.0, outer=110.0).slope == pytest.approx(
        math.degrees(math.atan(20.0 / 200.0))
    )


def test_sections_along_level_shoulders_are_horizontal() -> None:
    found = rotation_along_shoulders(SKIN, LANDMARKS)
    assert list(found) == ["T1", "T2"]
    for level, angle in found.items():
        wanted = back_surface_rotation(SKIN, LANDMARKS)[level]
        assert wanted is not None
        assert angle == pytest.approx(wanted.angle, abs=0.02)


def test_levels_without_landmarks_are_missing() -> None:
    keep = [i for i, name in enumerate(LANDMARKS.names) if not name.startswith("T2_")]
    fewer = Landmarks(tuple(LANDMARKS.names[i] for i in keep), LANDMARKS.points[keep])
    found = rotation_along_shoulders(SKIN, fewer)
    assert found["T1"] is not None
    assert found["T2"] is None
    without = [i for i in keep if not LANDMARKS.names[i].startswith("T1_")]
    fewer = Landmarks(tuple(LANDMARKS.names[i] for i in without), LANDMARKS.points[without])
    assert rotation_along_shoulders(SKIN, fewer) == {"T1": None, "T2": None}
