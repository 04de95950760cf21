"""Faults of a segmentation are named with the cure, and bones have the names of other programs."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy import ndimage

from support.blocks import blocks, moved, spine_and_hips
from support.trunk_shapes import joined
from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.geometry.surface import Surface
from warp_trunk.preparation.label_maps.mask import Mask
from warp_trunk.preparation.label_maps.segmentation_checks import doubts_of_bones, doubts_of_image, other_numbers
from warp_trunk.preparation.label_maps.sources import TABLES, known_name

Bones = dict[str, Surface]


def trunk() -> Bones:
    """Vertebrae, hip bones, and ribs that end 2 mm from the bodies of their vertebrae."""
    bones = spine_and_hips()
    for number in range(1, 13):
        middle = bones[f"T{number}"].vertices.mean(axis=0)
        for side, sign in (("left", 1), ("right", -1)):
            rib = blocks((((16, -4, -4), (100, 4, 4)),))
            rib = rib if sign > 0 else Surface(rib.vertices * [-1.0, 1.0, 1.0], rib.faces[:, ::-1])
            bones[f"rib_{side}_{number:02d}"] = moved(rib, np.eye(3), [0.0, middle[1], middle[2]])
    return bones


def front(bones: Bones) -> Bones:
    """A sternum 150 mm in front of T6."""
    return {"sternum": Surface(bones["T6"].vertices - [0.0, 150.0, 0.0], bones["T6"].faces)}


def scaled(bone: Surface, by: float) -> Surface:
    middle = bone.vertices.mean(axis=0)
    return Surface(middle + by * (bone.vertices - middle), bone.faces)


def renamed(bones: Bones, names: dict[str, str]) -> Bones:
    return {names.get(name, name): bone for name, bone in bones.items()}


def swapped(bones: Bones, names: list[str]) -> Bones:
    other = {n: n.replace("left", "#").replace("right", "left").replace("#", "right") for n in names}
    return renamed(bones, other)


def without(bones: Bones, *names: str) -> Bones:
    return {name: bone for name, bone in bones.items() if name not in names}


def skipped(bones: Bones) -> Bones:
    """T12 is not there, and all below stand one place higher."""
    up = bones["T11"].vertices.mean(axis=0) - bones["T12"].vertices.mean(axis=0)
    return {
        name: Surface(bone.vertices + up, bone.faces) if name[0] == "L" else bone
        for name, bone in without(bones, "T12", "rib_left_12", "rib_right_12").items()
    }


LEFT_UP = {f"rib_left_{n:02d}": f"rib_left_{n - 1:02d}" for n in range(2, 13)}
LEFT_DOWN = {f"rib_left_{n:02d}": f"rib_left_{n + 1:02d}" for n in range(1, 12)}
RIGHT_AROUND = {f"rib_right_{n:02d}": f"rib_right_{n + 2:02d}" for n in range(1, 11)} | {
    "rib_right_11": "rib_right_01"
}
FAULTS: dict[str, tuple[Callable[[Bones], Bones], list[str]]] = {
    "nothing": (lambda b: b, []),
    "two in one": (lambda b: {**without(b, "T9"), "T8": joined(b["T8"], b["T9"])},
                   ["T8: is 2.0 times as large as its neighbours"]),
    "a part of one": (lambda b: {**b, "L2": scaled(b["L2"], 0.7)}, ["L2: has 34 % of its neighbours' volume"]),
    "a jump in the numbers": (skipped, [
        "Of the left ribs number 12 has no label",
        "Of the right ribs number 12 has no label",
        "T11 and L1: are as near as neighbours, though T12 would be between them",
    ]),
    "a vertebra without a label, and the rest shifted": (
        lambda b: renamed(without(b, "L1", "L5"), {"L2": "L1", "L3": "L2", "L4": "L3"}),
        ["T12 and L1: are 2.0 times as far apart as their neighbours"]),
    "no label on L5": (lambda b: {**without(b, "L5"), "sacrum": moved(b["L5"], np.eye(3), [0.0, 0.0, -20.0])},
                       ["L4 and the sacrum are 19 mm apart: L5 has no label"]),
    "no label on L5 and its place closed": (lambda b: {**without(b, "L5"), "sacrum": b["L5"]},
                                            ["L4 reaches the sacrum, though L5 would be between them"]),
    "no label on T8": (lambda b: without(b, "T8"), ["T8 between T7 and T9 has no label"]),
    "all eleven ribs of a side one too low": (lambda b: renamed(without(b, "rib_left_01"), LEFT_UP), [
        "Of the left ribs number 12 has no label",
        "The left ribs 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11 lie at T2, T3",
    ]),
    "all eleven ribs of a side one too high": (lambda b: renamed(without(b, "rib_left_12"), LEFT_DOWN), [
        "Of the left ribs number 1 has no label",
        "The left ribs 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12 lie at T1, T2",
    ]),
    "turned by half a turn": (
        lambda b: {n: Surface(s.vertices * [-1, -1, 1], s.faces) for n, s in (b | front(b)).items()},
        ["Left and right are exchanged in all 13 pairs of bones and the sternum lies behind the spine"]),
    "front to back": (lambda b: {n: Surface(s.vertices * [1, -1, 1], s.faces) for n, s in (b | front(b)).items()},
                      ["The sternum lies behind the spine: the axes of the file are mirrored;"]),
    "all sides exchanged": (lambda b: swapped(b, [n for n in b if "left" in n or "right" in n]), [
        "Left and right are exchanged in all 13 pairs of bones: the axes of the file are mirrored"]),
    "one pair exchanged": (lambda b: swapped(b, ["rib_left_05", "rib_right_05"]),
                           ["rib_left_05: lies right of rib_right_05; exchange these two labels."]),
    "six lumbar vertebrae": (lambda b: {**b, "L6": moved(b["L5"], np.eye(3), [0.0, 0.0, -20.0])},
                             ["L6: is one more than most people have"]),
    "ribs numbered one too high": (lambda b: renamed(without(b, "rib_right_12"), RIGHT_AROUND), [
        "Of the right ribs number 2 has no label",
        "The right ribs 1, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12 lie at T11, T1",
    ]),
    "one rib numbered wrong": (lambda b: {**without(b, "rib_left_09"), "rib_left_04": b["rib_left_09"]},
                               ["Of the left ribs number 9 has no label", "rib_left_04: lies at T9, not at T4"]),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_segmentation_is_named_and_nothing_else(fault):
    change, said = FAULTS[fault]
    doubts = doubts_of_bones(change(trunk()))
    assert [part for part in said if not any(part in doubt for doubt in doubts)] == [], doubts
    assert len(doubts) == len({part for part in said if "mm from" not in part}), doubts


@pytest.mark.parametrize(
    ("axis", "side", "word"), [(0, 0, "right"), (0, 1, "left"), (1, 0, "front"), (1, 1, "back")]
)
def test_a_trunk_cut_off_by_the_border_of_the_image(axis, side, word):
    spine = {name: bone for name, bone in spine_and_hips().items() if name in VERTEBRAE}
    affine = np.diag([5.0, 5.0, 5.0, 1.0])
    affine[:3, 3] = -150.0, -150.0, 100.0
    first, shape = [10, 10, 10], [60, 60, 90]
    if side == 0:
        first[axis] = 0
    else:
        shape[axis] = 10 + (40, 32, 60)[axis]
    cut = Mask(np.ones((40, 32, 60), dtype=bool), (first[0], first[1], 10), affine, (shape[0], shape[1], 90))
    assert cut.faces_at_border() == [(axis, side)]
    doubts = [d for d in doubts_of_image({}, cut, spine) if f"by the {word} border" in d]
    assert len(doubts) == 1
    assert "rotation from T2 to L3 is not that of the patient" in doubts[0]


def test_bones_that_the_image_ends_in_are_named():
    inside = np.ones((4, 4, 4), dtype=bool)
    masks = {name: Mask(inside, first, np.eye(4), (20, 20, 20)) for name, first in
             (("T1", (5, 5, 16)), ("T2", (5, 5, 12)))}  # fmt: skip
    assert doubts_of_image(masks, None, {}) == ["The image ends in T1: only the parts that it shows are there."]


NAMES_OF_OTHERS = {
    "vertebrae_T8": "T8",
    "vertebrae_S1": "sacrum",
    "rib_left_1": "rib_left_01",
    "costal_cartilages": "costal_cartilages",
    "clavicula_right": "clavicle_right",
    "body_trunc": "skin",
    "body_extremities": "extremities",
    "subcutaneous_fat": "subcutaneous_fat",
    "skeletal_muscle": "skeletal_muscle",
    "eighth thoracic vertebra": "T8",
    "left first rib": "rib_left_01",
    "Right 7th rib": "rib_right_07",
    "left third costal cartilage": "costal_cartilage_left_03",
    "T8 vertebra": "T8",
    "T8": "T8",
}
STRANGE = [
    "spleen", "vertebrae_body", "intervertebral_discs", "hip_implant", "iliac_artery_left", "rib", "fifth rib",
    "rib_left_14", "vertebrae_T14", "vertebrae_T0", "vertebrae", "gluteus_maximus_left", "hip", "left right hip",
    "kidney_cyst_left", "", "8", "T", "costal_cartilage_left_11", "torso_fat", "heart", "body of sternum", "FMA1",
]  # fmt: skip


@pytest.mark.parametrize(("name", "ours"), NAMES_OF_OTHERS.items())
def test_a_bone_is_known_by_the_names_of_others(name, ours):
    assert known_name(name) == ours


@pytest.mark.parametrize("name", STRANGE)
def test_what_is_none_of_ours_is_left_over(name):
    assert known_name(name) is None


def test_tables_of_both_versions_name_the_same_bones():
    ours = {version: {known_name(name) for name in table.values()} for version, table in TABLES.items()}
    assert None not in ours["totalsegmentator-v2"]
    assert ours["totalsegmentator-v2"] - ours["totalsegmentator-v1"] == {"sternum", "costal_cartilages"}
    assert ours["totalsegmentator-v1"] < ours["totalsegmentator-v2"]


def test_numbers_that_were_read_off_the_programs_themselves():
    new, old = TABLES["totalsegmentator-v2"], TABLES["totalsegmentator-v1"]
    assert [old[18], old[34], old[58], old[81], old[91]] == [
        "vertebrae_L5", "vertebrae_T1", "rib_left_1", "rib_right_12", "hip_right",
    ]  # fmt: skip
    assert [new[27], new[43], new[50], new[69], new[78], new[92], new[115]] == [
        "vertebrae_L5", "vertebrae_T1", "vertebrae_C1", "humerus_left", "hip_right", "rib_left_1", "rib_right_12",
    ]  # fmt: skip


def test_a_shell_and_a_body_with_holes_for_bones_are_filled_and_arms_beside_it_stay_apart():
    """By counts: a block with a bar beside it that joins it above and below, as an arm does."""
    whole = np.zeros((40, 30, 50), dtype=bool)
    whole[4:24, 4:26, :] = True
    whole[24:34, 10:20, 6:12], whole[24:34, 10:20, 38:44], whole[30:34, 10:20, 6:44] = True, True, True
    core = ndimage.binary_erosion(np.pad(whole, ((0, 0), (0, 0), (1, 1)), mode="edge"))
    shell = whole & np.logical_not(core)[:, :, 1:-1]
    holes = whole.copy()
    holes[10:14, 10:14, 5:45] = False
    holes[6:8, 4:9, 20:22] = False  # a gap to the outside of two voxels
    for inside in (shell, holes, whole):
        mask = Mask(inside, (0, 0, 0), np.eye(4), inside.shape).filled()
        assert np.count_nonzero(mask.inside ^ whole) <= 84  # the gap, and voxels in four corners behind the arm
    assert not mask.inside[26:29, 12, 20].any()


def test_numbers_of_another_model_are_named():
    """Hips with the numbers of T5 and T6."""
    hips = {"T5": blocks((((60, 0, 0), (90, 40, 80)),)), "T6": blocks((((-90, 0, 0), (-60, 40, 80)),))}
    (said,) = other_numbers(hips)
    assert "T5 and T6 lie 150 mm beside each other" in said
    stack = {f"T{n}": blocks((((-20 + 5 * n, 0, -30 * n), (20 + 5 * n, 30, 20 - 30 * n)),)) for n in range(3, 9)}
    assert other_numbers(stack) == []
