from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.small_case import small_case
from warp_trunk.case import read_case, write_case
from warp_trunk.case.bone_checks import check_bones_after
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface


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
