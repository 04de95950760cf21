"""Names of bones that move each on its own."""

from __future__ import annotations

from warp_trunk.bone_motion.bone_names import unknown_bones

NAMED = ("T1", "L5", "C7", "rib_left_01", "costal_cartilage_right_07", "sternum", "scapula_left", "hip_right")


def test_names_of_bones_are_known() -> None:
    assert unknown_bones(NAMED) == []


def test_unknown_names_are_told() -> None:
    (one,) = unknown_bones((*NAMED, "rib_left_8"))
    assert one.startswith("bones: rib_left_8 is moved as one body")
    (two,) = unknown_bones((*NAMED, "rib_left_8", "costa"))
    assert two.startswith("bones: costa, rib_left_8 are moved as one body")
    (five,) = unknown_bones("abcde")
    assert five.startswith("bones: a, b, c and 2 more are moved")
