"""Faults of a segmentation are named with the cure, and bones have the names of other programs."""

from collections.abc import Callable

import numpy as np
from scipy import ndimage

from support.blocks import blocks, moved, spine_and_hips
from support.shown import check_shown
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
FAULTS: dict[str, Callable[[Bones], Bones]] = {
    "nothing": lambda b: b,
    "two in one": lambda b: {**without(b, "T9"), "T8": joined(b["T8"], b["T9"])},
    "a part of one": lambda b: {**b, "L2": scaled(b["L2"], 0.7)},
    "a jump in the numbers": skipped,
    "a vertebra without a label, and the rest shifted": (
        lambda b: renamed(without(b, "L1", "L5"), {"L2": "L1", "L3": "L2", "L4": "L3"})
    ),
    "no label on L5": (lambda b: {**without(b, "L5"), "sacrum": moved(b["L5"], np.eye(3), [0.0, 0.0, -20.0])}),
    "no label on L5 and its place closed": lambda b: {**without(b, "L5"), "sacrum": b["L5"]},
    "no label on T8": lambda b: without(b, "T8"),
    "all eleven ribs of a side one too low": lambda b: renamed(without(b, "rib_left_01"), LEFT_UP),
    "all eleven ribs of a side one too high": lambda b: renamed(without(b, "rib_left_12"), LEFT_DOWN),
    "turned by half a turn": (
        lambda b: {n: Surface(s.vertices * [-1, -1, 1], s.faces) for n, s in (b | front(b)).items()}
    ),
    "front to back": lambda b: {n: Surface(s.vertices * [1, -1, 1], s.faces) for n, s in (b | front(b)).items()},
    "all sides exchanged": lambda b: swapped(b, [n for n in b if "left" in n or "right" in n]),
    "one pair exchanged": lambda b: swapped(b, ["rib_left_05", "rib_right_05"]),
    "six lumbar vertebrae": lambda b: {**b, "L6": moved(b["L5"], np.eye(3), [0.0, 0.0, -20.0])},
    "ribs numbered one too high": lambda b: renamed(without(b, "rib_right_12"), RIGHT_AROUND),
    "one rib numbered wrong": lambda b: {**without(b, "rib_left_09"), "rib_left_04": b["rib_left_09"]},
}


def cut_off(axis: int, side: int) -> Mask:
    """A trunk that the border of its image cuts off, at the lower (0) or upper (1) end of an axis."""
    affine = np.diag([5.0, 5.0, 5.0, 1.0])
    affine[:3, 3] = -150.0, -150.0, 100.0
    first, shape = [10, 10, 10], [60, 60, 90]
    if side == 0:
        first[axis] = 0
    else:
        shape[axis] = 10 + (40, 32, 60)[axis]
    cut = Mask(np.ones((40, 32, 60), dtype=bool), (first[0], first[1], 10), affine, (shape[0], shape[1], 90))
    assert cut.faces_at_border() == [(axis, side)]
    return cut


def test_the_doubts_of_a_segmentation_are_as_accepted():
    """A fault is named, and nothing else."""
    shown, bones = [], trunk()
    for fault, change in FAULTS.items():
        shown += [f"== {fault}", *doubts_of_bones(change(bones))]
    spine = {name: bone for name, bone in spine_and_hips().items() if name in VERTEBRAE}
    for axis, side in ((0, 0), (0, 1), (1, 0), (1, 1)):
        shown += [
            f"== the body ends at border {side} of axis {axis}",
            *doubts_of_image({}, cut_off(axis, side), spine),
        ]
    inside = np.ones((4, 4, 4), dtype=bool)
    ends = {name: Mask(inside, (5, 5, low), np.eye(4), (20, 20, 20)) for name, low in (("T1", 16), ("T2", 12))}
    shown += ["== the image ends in T1", *doubts_of_image(ends, None, {})]
    hips = {"T5": blocks((((60, 0, 0), (90, 40, 80)),)), "T6": blocks((((-90, 0, 0), (-60, 40, 80)),))}
    stack = {f"T{n}": blocks((((-20 + 5 * n, 0, -30 * n), (20 + 5 * n, 30, 20 - 30 * n)),)) for n in range(3, 9)}
    shown += ["== hips with the numbers of T5 and T6", *other_numbers(hips), *other_numbers(stack)]
    check_shown("segmentation_doubts", shown)


NAMES_OF_OTHERS = (
    "vertebrae_T8", "vertebrae_S1", "rib_left_1", "costal_cartilages", "clavicula_right", "body_trunc",
    "body_extremities", "subcutaneous_fat", "skeletal_muscle", "eighth thoracic vertebra", "left first rib",
    "Right 7th rib", "left third costal cartilage", "T8 vertebra", "T8", "spleen", "vertebrae_body",
    "intervertebral_discs", "hip_implant", "iliac_artery_left", "rib", "fifth rib", "rib_left_14", "vertebrae_T14",
    "vertebrae_T0", "vertebrae", "gluteus_maximus_left", "hip", "left right hip", "kidney_cyst_left", "", "8", "T",
    "costal_cartilage_left_11", "torso_fat", "heart", "body of sternum", "FMA1",
)  # fmt: skip


def test_names_and_numbers_of_other_programs_are_as_accepted():
    """Numbers were read off the programs themselves; what is none of ours is left over."""
    tables = [f"{version} {number} {name}: {known_name(name)}" for version, table in TABLES.items()
              for number, name in table.items()]  # fmt: skip
    check_shown("names_of_bones", [*(f"{name!r}: {known_name(name)}" for name in NAMES_OF_OTHERS), *tables])


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
