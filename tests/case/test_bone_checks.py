"""Bones: their side, their depth under the skin, and their shape after surgery."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.small_case import small_case
from warp_trunk.case import check_case, read_case, write_case
from warp_trunk.case.bone_checks import check_bones_after, unusual_depth
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface


def test_left_and_right_exchanged_are_refused():
    case = small_case()
    bones = case.bones
    mirrored = Surface(
        bones["rib_left_07"].vertices * [-1.0, 1.0, 1.0], bones["rib_left_07"].faces[:, ::-1].copy()
    )
    good = replace(case, bones=bones | {"rib_right_07": mirrored})
    assert check_case(good) == ()
    wrong = replace(case, bones=bones | {"rib_right_07": bones["rib_left_07"], "rib_left_07": mirrored})
    with pytest.raises(
        InputError, match=r"^rib_left_07: must lie left of rib_right_07, but lies \d+ mm right of it"
    ):
        check_case(wrong)


@pytest.mark.parametrize("factor", [1.0, 1.45])
def test_a_skin_of_another_scale_is_warned_of(factor):
    case = small_case()
    middle = case.skin.vertices.mean(axis=0)
    skin = Surface((case.skin.vertices - middle) * factor + middle, case.skin.faces)
    found = check_case(replace(case, skin=skin))
    assert len(found) == (factor > 1.0)
    assert all(text.startswith("skin: the vertebrae lie") and "3 to 35 mm is usual" in text for text in found)


def test_only_vertebrae_tell_how_deep_bones_are():
    assert unusual_depth({"hip_left": 90.0}, "skin") == []
    assert len(unusual_depth({"hip_left": 20.0, "T5": 60.0, "L1": 50.0}, "skin")) == 1


def with_sternum(bend: float = 0.0, name: str = "sternum", keep: int | None = None):
    """The small case and its sternum after surgery, turned and shifted, and bent."""
    case = small_case()
    bone = case.bones["sternum"]
    points = Rotation.from_rotvec([0.1, 0.0, 0.2]).apply(bone.vertices) + 4.0
    height = (bone.vertices[:, 2] - bone.vertices[:, 2].mean()) / np.ptp(bone.vertices[:, 2])
    points[:, 1] += bend * height**2
    return replace(case, bones_after={name: Surface(points[:keep], bone.faces)})


def check(case) -> None:
    check_bones_after(case, 3.0, lambda key: f"{key}.ply")


def test_a_bone_moved_rigidly_passes() -> None:
    check(with_sternum())


def test_folder_keeps_them(tmp_path) -> None:
    case = with_sternum()
    write_case(tmp_path, case)
    back = read_case(tmp_path).bones_after
    np.testing.assert_array_equal(back["sternum"].vertices, case.bones_after["sternum"].vertices)
    with pytest.raises(InputError, match=r"bones_after/sternum\.ply.*remove it"):
        write_case(tmp_path, small_case())


def test_a_bent_bone_is_refused_by_its_residual() -> None:
    with pytest.raises(InputError, match=r"bones_after/sternum\.ply: is \d+\.\d mm .* 3 mm is allowed"):
        check(with_sternum(bend=80.0))


def test_another_number_of_vertices_is_refused() -> None:
    case = with_sternum(keep=5)
    bone = Surface(case.bones_after["sternum"].vertices, np.array([[0, 1, 2], [2, 3, 4]], dtype=np.int32))
    with pytest.raises(InputError, match=r"has 5 vertices, but the bone before has \d+"):
        check(replace(case, bones_after={"sternum": bone}))


def test_a_bone_that_was_not_there_is_refused() -> None:
    with pytest.raises(InputError, match="no bone 'manubrium' before"):
        check(with_sternum(name="manubrium"))
