"""Names of bones that move each on its own."""

from __future__ import annotations

import pytest

from warp_trunk.bone_motion.bone_names import check_bone_names, unknown_bones
from warp_trunk.errors import InputError

NAMED = ("T1", "L5", "C7", "rib_left_01", "costal_cartilage_right_07", "sternum", "scapula_left", "hip_right")


@pytest.mark.parametrize("bones", [NAMED, ("T8",), ()])
def test_named_as_is_expected(bones: tuple[str, ...]) -> None:
    check_bone_names(bones)
    assert unknown_bones(bones) == []


@pytest.mark.parametrize(
    ("bones", "named"),
    [
        (("skeleton",), "none of skeleton is named"),
        (("vertebrae_T8", "rib_left_08"), "none of rib_left_08, vertebrae_T8 is named"),
        (("a", "b", "c", "d", "e"), "none of a, b, c and 2 more is named"),
    ],
)
def test_bones_without_a_vertebra_are_refused_with_the_cure(bones: tuple[str, ...], named: str) -> None:
    with pytest.raises(InputError, match=named) as error:
        check_bone_names(bones)
    assert "--bones spline" in str(error.value)


def test_unknown_names_are_told() -> None:
    (one,) = unknown_bones((*NAMED, "rib_left_8"))
    assert one.startswith("bones: rib_left_8 is moved as one body")
    (two,) = unknown_bones((*NAMED, "rib_left_8", "costa"))
    assert two.startswith("bones: costa, rib_left_8 are moved as one body")
