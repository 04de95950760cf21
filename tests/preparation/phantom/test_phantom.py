"""The synthetic trunk: its shapes, bones and skin, straight and with a curve."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from warp_trunk.case import check_case
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.surface_checks import check_solid, components
from warp_trunk.preparation.deformity import SpineCurve
from warp_trunk.preparation.phantom import phantom_case, straight_trunk
from warp_trunk.preparation.phantom.bones import skeleton
from warp_trunk.preparation.phantom.skin import EDGE


def test_it_is_solid_and_its_bones_lie_under_the_skin():
    skin, bones, landmarks = straight_trunk()
    np.testing.assert_allclose(np.ptp(skin.vertices, axis=0), [326.0, 225.0, 575.0])
    check_solid(skin, "skin")
    assert components(skin).max() == 0
    assert 3000 <= len(skin.vertices) <= 5000
    edges = np.linalg.norm(np.diff(skin.vertices[skin.faces[:, [0, 1, 2, 0]]], axis=1), axis=2)
    assert 0.9 * EDGE < np.median(edges) < 1.1 * EDGE
    assert edges.max() < 2.5 * EDGE
    distance = SurfaceDistance(skin)
    for name, bone in bones.items():
        check_solid(bone, name)
        assert distance.at(bone.vertices).max() < -4.0, name
    assert len(landmarks.names) == 104


def test_the_case_has_the_curve_it_says():
    """Cobb angles from the endplates alone, not through the code that bends the spine."""
    case = phantom_case()

    def cobb(landmarks) -> float:
        tilts = []
        for bone in landmarks.vertebrae():
            x, _, z = landmarks.point(f"{bone}_superior_endplate") - landmarks.point(f"{bone}_inferior_endplate")
            tilts.append(np.degrees(np.arctan2(x, z)))
        return max(tilts) - min(tilts)

    assert cobb(case.landmarks_before) == pytest.approx(55.0, abs=1.0)
    assert cobb(case.planned_landmarks) == pytest.approx(0.3 * 55.0, abs=1.0)
    np.testing.assert_array_equal(
        case.landmarks_before.of_bone("hip_left").points, case.planned_landmarks.of_bone("hip_left").points
    )


def test_a_deformed_case_passes_every_check():
    case = phantom_case(SpineCurve(kind="double_major", cobb=70.0, direction="left"))
    check_case(case)
    distance = SurfaceDistance(case.skin)
    for name, bone in case.bones.items():
        check_solid(bone, name)
        assert distance.at(bone.vertices).max() <= -4.0, name


def test_bones_and_landmarks_are_mirror_images():
    bones, landmarks = skeleton()
    for name in (*bones, *landmarks.names):
        mirrored = name.replace("left", "#").replace("right", "left").replace("#", "right")
        if name in bones:
            gap, _ = KDTree(bones[mirrored].vertices).query(bones[name].vertices * [-1.0, 1.0, 1.0])
        else:
            gap = landmarks.point(name) * [-1.0, 1.0, 1.0] - landmarks.point(mirrored)
        assert np.abs(gap).max() < 1e-12, name
