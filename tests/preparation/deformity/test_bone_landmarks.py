import os
from pathlib import Path

import numpy as np
import pytest

from support.blocks import VERTEBRA, blocks, moved, skeleton
from warp_trunk.case.landmarks import VERTEBRA_POINTS, bone_of
from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.io.surface_files import read_surface
from warp_trunk.preparation.deformity.bone_landmarks import VERTEBRAE, find_landmarks


def test_points_of_a_vertebra_of_known_shape() -> None:
    found = find_landmarks(skeleton())
    assert found.names == (*(f"T7_{point}" for point in VERTEBRA_POINTS), "asis_left", "asis_right")
    np.testing.assert_allclose(found.points[:2], [[0, -45, 520], [0, -45, 500]], atol=1e-6)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for end, height in (("superior", 518.0), ("inferior", 510.0)):
            x, y, z = found.point(f"T7_{side}_pedicle_{end}")
            assert 8.0 <= sign * x <= 14.0
            assert -30.0 < y < -18.0
            assert z == pytest.approx(height)


@pytest.mark.parametrize("degrees", [-25.0, 15.0])
def test_points_turn_with_a_vertebra_that_leans_forward_or_back(degrees: float) -> None:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    lean = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    upright = skeleton()
    leaning = {**upright, "T7": moved(upright["T7"], lean, [0.0, 0.0, 0.0])}
    gap = np.linalg.norm(find_landmarks(leaning).points - find_landmarks(upright).points @ lean.T, axis=1)
    assert gap[:2].max() < 0.5
    assert gap[2:6].max() < 6.5  # anywhere along the edge of a pedicle, which is as wide as that


def test_iliac_spine_is_not_the_pubis() -> None:
    for side, sign in (("left", 1.0), ("right", -1.0)):
        x, y, z = find_landmarks(skeleton()).point(f"asis_{side}")
        assert y == -80.0
        assert z > 80.0
        assert sign * x >= 80.0


def test_missing_bones_are_named() -> None:
    bones = skeleton()
    with pytest.raises(InputError, match="'hip_right' is missing"):
        find_landmarks({name: bone for name, bone in bones.items() if name != "hip_right"})
    with pytest.raises(InputError, match="any of T1 to L5 is missing"):
        find_landmarks({name: bone for name, bone in bones.items() if name != "T7"})


def test_vertebra_without_arch_is_named() -> None:
    body = moved(blocks(VERTEBRA[:1]), np.eye(3), [0.0, 0.0, 500.0])
    with pytest.raises(InputError, match="'T7' shows no left pedicle"):
        find_landmarks({**skeleton(), "T7": body})


def test_real_anatomy() -> None:
    folder = os.environ.get("WARP_TRUNK_ANATOMY")
    if not folder or not Path(folder).is_dir():
        pytest.skip("WARP_TRUNK_ANATOMY names no folder with skin.ply and bones/")
    bones = {path.stem: read_surface(path) for path in sorted(Path(folder, "bones").glob("*.ply"))}
    found = find_landmarks(bones)
    assert len(found.names) == 17 * 6 + 2
    for name, point in zip(found.names, found.points, strict=True):
        bone = bones[bone_of(name, bones) or ""]
        assert abs(SurfaceDistance(bone).at(point[None])[0]) < 0.01, name
    superior, inferior = (
        np.array([found.point(f"{bone}_{end}_endplate") for bone in VERTEBRAE]) for end in ("superior", "inferior")
    )
    assert (superior[:, 2] > inferior[:, 2] + 10.0).all()
    assert (inferior[:-1, 2] > superior[1:, 2]).all()  # discs
    for bone in VERTEBRAE:
        left, right = (found.point(f"{bone}_{side}_pedicle_superior") for side in ("left", "right"))
        assert 12.0 < left[0] - right[0] < 60.0
        assert abs(left[2] - right[2]) < 3.0  # this spine is its own mirror image, but for the meshing
        assert left[1] > superior[VERTEBRAE.index(bone), 1]
    left, right = found.point("asis_left"), found.point("asis_right")
    assert 200.0 < left[0] - right[0] < 320.0
    # above the hip joints, below the top of the crest
    assert 60.0 < left[2] - bones["hip_left"].vertices[:, 2].min() < 180.0
