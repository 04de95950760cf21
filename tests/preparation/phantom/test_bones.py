import numpy as np
import pytest
from scipy.spatial import KDTree

from warp_trunk.case.landmarks import ASIS, VERTEBRA_POINTS, VERTEBRAE
from warp_trunk.geometry.surface_checks import check_solid, enclosed_volume
from warp_trunk.preparation.phantom.bones import skeleton

BONES, LANDMARKS = skeleton()


def test_every_bone_is_there_and_solid():
    ribs = [f"rib_{side}_{number:02d}" for side in ("left", "right") for number in range(1, 13)]
    assert set(BONES) == {*VERTEBRAE, *ribs, "sternum", "sacrum", "hip_left", "hip_right"}
    for name, bone in BONES.items():
        check_solid(bone, name)


def mirror(name: str) -> str:
    if "left" in name:
        return name.replace("left", "right")
    return name.replace("right", "left")


def test_bones_and_landmarks_are_mirror_images():
    for name, bone in BONES.items():
        gap, _ = KDTree(BONES[mirror(name)].vertices).query(bone.vertices * [-1.0, 1.0, 1.0])
        assert gap.max() < 1e-12
    for name in LANDMARKS.names:
        np.testing.assert_allclose(
            LANDMARKS.point(name) * [-1.0, 1.0, 1.0], LANDMARKS.point(mirror(name)), atol=1e-12
        )


def test_ribs_are_thick_enough_for_a_grid_of_4_mm():
    """Four times volume over surface is the diameter of a long round tube, and less for a flatter one."""
    for name, bone in BONES.items():
        if name.startswith("rib"):
            a, b, c = np.moveaxis(bone.vertices[bone.faces], 1, 0)
            area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
            assert 4.0 * enclosed_volume(bone) / area > 8.5


def test_landmarks_are_where_their_names_say():
    for bone in VERTEBRAE:
        top, bottom, left_top, left_bottom, right_top, right_bottom = (
            LANDMARKS.point(f"{bone}_{point}") for point in VERTEBRA_POINTS
        )
        body = 0.5 * (top + bottom)
        assert top[2] - bottom[2] > 10.0
        assert abs(body[0]) < 1e-12
        for left, right in ((left_top, right_top), (left_bottom, right_bottom)):
            assert left[0] > 4.0
            assert right[0] < -4.0
            assert left[1] > body[1] + 5.0  # behind the body
        assert left_top[2] - left_bottom[2] > 4.0
        assert left_top[2] < top[2] + 0.5 * (top[2] - bottom[2])
        assert left_bottom[2] > bottom[2]
    for name, bone in ASIS.items():
        front = BONES[bone].vertices[:, 1].min()
        assert LANDMARKS.point(name)[1] == pytest.approx(front, abs=2.0)
