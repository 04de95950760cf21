"""Bones on their side, and skin at the distance that skin has."""

from dataclasses import replace

import pytest

from support.small_case import small_case
from warp_trunk.case import check_case
from warp_trunk.case.bone_checks import unusual_depth
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
