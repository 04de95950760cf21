"""Files that are called nearly as a bone is."""

from pathlib import Path

import pytest

from warp_trunk.case.anatomy import check_file_names
from warp_trunk.errors import InputError


@pytest.mark.parametrize(
    ("name", "bone"),
    [
        ("t8", "T8"), ("T08", "T8"), ("T_8", "T8"), ("vertebrae_T8", "T8"), ("l5 vertebra", "L5"),
        ("rib_left_1", "rib_left_01"), ("Rib-Right-12", "rib_right_12"), ("left_rib_1", "rib_left_01"),
        ("Sacrum", "sacrum"), ("left hip", "hip_left"), ("HIP_RIGHT", "hip_right"),
        ("Th8", "T8"), ("D8", "T8"), ("T8 copy", "T8"), ("L5_bone", "L5"), ("rib_l_07", "rib_left_07"),
        ("hip_r", "hip_right"), ("pelvis_left", "hip_left"), ("os sacrum", "sacrum"),
    ],
)  # fmt: skip
def test_a_file_called_nearly_as_a_bone_is_named(name, bone):
    with pytest.raises(InputError, match=rf"a case calls this bone {bone}; rename the file to {bone}\.stl"):
        check_file_names({name: Path(f"bones/{name}.stl")})


def test_other_names_stay():
    names = ("T8", "rib_left_01", "mandible", "sternum_upper", "hip_left_lower", "T7x", "S1", "bone 12", "")
    check_file_names({name: Path(name) for name in names})
