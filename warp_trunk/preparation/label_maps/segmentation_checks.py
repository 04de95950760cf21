"""Checks of a segmentation and of its image: common faults and what is cut off, each with the cure."""

from __future__ import annotations

from collections.abc import Container, Mapping
from itertools import pairwise

import numpy as np

from warp_trunk.case.anatomy import SIDES, VERTEBRAE, rib_of
from warp_trunk.case.axes import exchanged_pairs, misplaced
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import enclosed_volume

from ..landmark_finder.find import medians_of_neighbours
from .mask import Mask

_LARGER, _SMALLER = 1.7, 0.5
"""Volume of a vertebra over the median of its neighbours', which grow by a tenth from one to the next."""
_WIDER = 1.6
"""Distance between two neighbours over the median of those around."""
_BESIDE = 60.0
"""No vertebra lies this far beside the next one [mm]: 25 in curves of 100 degrees."""
_FROM_VERTEBRA = 8.0
"""The head of a rib is nearer to its vertebra than this [mm]: 3 mm at most in the anatomy of BodyParts3D."""
_FROM_SACRUM = 12.0
"""The lowest vertebra is nearer to the sacrum than this [mm]: their joints touch."""
_ALIKE = 3
"""If this many ribs of a side lie at another vertebra than their number states, the numbering is wrong."""
_OTHER_SIZE = 0.0005
"""Voxels of images of one scan differ in size by less than this part."""
_APART, _OUTSIDE, _SAMPLE = 1.0, 0.05, 500
"""Headers of one image place a voxel alike within this [mm]; more than this share of a bone outside the body says
that they do not fit; number of voxels of a bone that are tried."""
_LEAST_BORDER_AREA = 400.0
"""A smaller part of the skin at the border is a corner of the image [mm2]."""


def doubts_of_bones(bones: Mapping[str, Surface], parts: Container[str] = ()) -> list[str]:
    """A sentence with the cure for each doubtful bone of a segmentation.

    Args:
        bones: surfaces by name, in LPS [mm].
        parts: those that the image cuts off, whose size and ends say nothing.
    """
    spine = {name: bones[name] for name in VERTEBRAE if name in bones and name not in parts}
    ribs = {name: bone for name, bone in bones.items() if name not in parts}
    return [
        *wrong_way_round(bones),
        *_sides(bones),
        *_numbers(bones),
        *_sizes(spine),
        *_spacing(spine),
        *_at_sacrum(bones, parts),
        *_ribs(ribs, spine),
    ]


def wrong_way_round(bones: Mapping[str, Surface]) -> list[str]:
    """A sentence where the bones lie the wrong way round: the axes of the file are not those of the patient."""
    wrong = misplaced(bones)
    if not wrong:
        return []
    what, sides = " and ".join(wrong.values()), 0 in wrong
    if len(wrong) % 2:
        cure = f"the axes of the file are mirrored{', or the names' if sides else ''}"
    else:
        cure = "the file is turned by half a turn, as one in RAS that is read as LPS"
    check = ", and look where the heart is: exchanging names would mirror the patient" if sides else ""
    return [f"{what[0].upper()}{what[1:]}: {cure}; write the file again with its orientation{check}."]


def other_numbers(bones: Mapping[str, Surface]) -> list[str]:
    """A sentence where vertebrae lie beside each other, as hips and ribs do that carry their numbers."""
    spine = [(name, bones[name].vertices.mean(axis=0)) for name in VERTEBRAE if name in bones]
    for (upper, upper_centre), (lower, other) in pairwise(spine):
        aside = float(np.linalg.norm((other - upper_centre)[:2]))
        levels = VERTEBRAE.index(lower) - VERTEBRAE.index(upper)
        if aside > _BESIDE * levels:
            what = f"{upper} and {lower} lie {aside:.0f} mm beside each other, which no vertebrae do"
            return [f"{what}: the labels have the numbers of another model; give its table by --labels."]
    return []


def _sides(bones: Mapping[str, Surface]) -> list[str]:
    """Pairs whose left bone lies right of the right one, where others do not."""
    wrong, pairs = exchanged_pairs({name: bone.vertices.mean(axis=0) for name, bone in bones.items()})
    if len(wrong) == len(pairs):
        return []
    return [f"{left}: lies right of {pairs[left]}; exchange these two labels." for left in wrong]


def _numbers(bones: Mapping[str, Surface]) -> list[str]:
    """More or fewer ribs and vertebrae than usual."""
    doubts = [
        f"{name}: is one more than most people have, and gets no landmarks; look whether the numbering is shifted."
        for name in sorted(bones)
        if name in ("T13", "L6") or name.endswith("_13")
    ]
    for side in SIDES:
        missing = [str(n) for n in range(1, 13) if f"rib_{side}_{n:02d}" not in bones]
        if 0 < len(missing) < 12:
            what = f"Of the {side} ribs number {', '.join(missing)} has no label"
            doubts.append(
                f"{what}: cut off by the image, not there in this patient, or numbered wrong; look which."
            )
    return doubts


def _sizes(spine: Mapping[str, Surface]) -> list[str]:
    """Vertebrae much larger or smaller than their neighbours."""
    volumes = {name: enclosed_volume(bone) for name, bone in spine.items()}
    doubts = []
    for name, usual in medians_of_neighbours(volumes, 2).items():
        share = volumes[name] / usual
        if share > _LARGER:
            doubts.append(
                f"{name}: is {share:.1f} times as large as its neighbours; divide it if it is two vertebrae."
            )
        if share < _SMALLER:
            what = f"{name}: has {100 * share:.0f} % of its neighbours' volume"
            doubts.append(f"{what}; look whether a part of it is in another label.")
    return doubts


def _spacing(spine: Mapping[str, Surface]) -> list[str]:
    """Numbers that jump where no bone is left out, and bones left out where no number is."""
    if len(spine) < 3:
        return []
    gaps = np.linalg.norm(np.diff([bone.vertices.mean(axis=0) for bone in spine.values()], axis=0), axis=1)
    steps = np.diff([VERTEBRAE.index(name) for name in spine])
    doubts = []
    for i, (upper, lower) in enumerate(pairwise(spine)):
        around = [gaps[k] / steps[k] for k in range(max(0, i - 2), min(len(gaps), i + 3)) if k != i]
        share = gaps[i] / float(np.median(around))
        if steps[i] == 1 and share > _WIDER:
            what = f"{upper} and {lower}: are {share:.1f} times as far apart as their neighbours; look whether a"
            doubts.append(f"{what} vertebra between them has no label, and the numbers below it are shifted.")
        left_out = ", ".join(VERTEBRAE[VERTEBRAE.index(upper) + 1 : VERTEBRAE.index(lower)])
        if steps[i] > 1 and share > steps[i] - 0.3:  # half a step less where one label holds both
            doubts.append(f"{left_out} between {upper} and {lower} has no label; add it, or plan without.")
        elif steps[i] > 1 and share < 0.5 * (1 + steps[i]):
            what = f"{upper} and {lower}: are as near as neighbours, though {left_out} would be between them"
            doubts.append(f"{what}; look whether the numbers jump or the patient has fewer vertebrae.")
    return doubts


def _at_sacrum(bones: Mapping[str, Surface], parts: Container[str]) -> list[str]:
    """A vertebra without a label above the sacrum, or numbers that are shifted there."""
    from scipy.spatial import KDTree  # heavy

    lumbar = [name for name in (*VERTEBRAE, "L6") if name in bones and name[0] == "L"]
    if not lumbar or "sacrum" not in bones or lumbar[-1] in parts or "sacrum" in parts:
        return []
    lowest, most = lumbar[-1], VERTEBRAE[-1]
    gap = float(KDTree(bones["sacrum"].vertices).query(bones[lowest].vertices)[0].min())
    if gap > _FROM_SACRUM:
        missing = (
            "a vertebra between them" if lowest >= most else ", ".join(VERTEBRAE[VERTEBRAE.index(lowest) + 1 :])
        )
        return [
            f"{lowest} and the sacrum are {gap:.0f} mm apart: {missing} has no label; add it, or plan without."
        ]
    if lowest < most:
        what = f"{lowest} reaches the sacrum, though {most} would be between them"
        return [f"{what}; look whether the numbers are shifted or the patient has fewer vertebrae."]
    return []


def _ribs(bones: Mapping[str, Surface], spine: Mapping[str, Surface]) -> list[str]:
    """Ribs away from their vertebrae, or at others."""
    from scipy.spatial import KDTree  # heavy

    trees = {int(name[1:]): KDTree(bone.vertices) for name, bone in spine.items() if name[0] == "T"}
    shifts: dict[str, dict[int, int]] = {side: {} for side in SIDES}
    headless: dict[tuple[str, int], float] = {}
    doubts = []
    for name, rib in ((name, rib_of(name)) for name in sorted(bones)):
        if rib is None or rib.number not in trees:
            continue
        number = rib.number
        points = bones[name].vertices
        if (gap := trees[number].query(points)[0].min()) <= _FROM_VERTEBRA:
            continue
        away = {level: tree.query(points)[0].min() for level, tree in trees.items()}
        at = min(away, key=lambda level: away[level])
        if at != number and (at != number - 1 or away[at] <= _FROM_VERTEBRA):
            shifts[rib.side][number] = at
        if at in (number - 1, number):
            headless[rib.side, number] = gap
    for (side, number), gap in headless.items():
        if len(shifts[side]) < _ALIKE:  # a rib begins between its vertebra and the one above
            shifts[side].pop(number, None)
            what = f"rib_{side}_{number:02d}: ends {gap:.0f} mm from T{number}"
            doubts.append(f"{what}; add the head that is missing from the label.")
    for side, moved in shifts.items():
        if len(moved) >= _ALIKE:
            what = f"The {side} ribs {', '.join(map(str, moved))} lie at T{', T'.join(map(str, moved.values()))}"
            doubts.append(f"{what}: correct their numbers or those of the vertebrae, which are shifted.")
            continue
        for number, at in moved.items():
            doubts.append(
                f"rib_{side}_{number:02d}: lies at T{at}, not at T{number}; look whether its number is wrong."
            )
    return doubts


def doubts_of_extents(masks: Mapping[str, Mask], bones: Mapping[str, Mask]) -> list[str]:
    """A sentence for each mask that does not fit the labels: by its header, or as it leaves bones outside.

    Args:
        masks: the body and masks of tissue, by what to call them.
        bones: the labels by name.
    """
    if not bones:
        return []
    reference, doubts = next(iter(bones.values())), []
    for name, mask in masks.items():
        if mask.shape == reference.shape:
            apart = np.linalg.norm(mask.corners(whole=True) - reference.corners(whole=True), axis=1).max()
            sizes = mask.spacing / reference.spacing
            if np.abs(sizes - 1.0).max() > _OTHER_SIZE:
                what = f"has voxels of {sizes[np.abs(sizes - 1.0).argmax()]:.4f} times the size of the labels'"
                far = f"and as many of them, so that one is wrong by up to {apart:.1f} mm"
                doubts.append(
                    f"{name[0].upper()}{name[1:]} {what}, {far}; write both with the header of one image."
                )
            elif apart > max(_APART, reference.spacing.max()):
                what = f"has as many voxels as the labels, but its header puts them up to {apart:.0f} mm elsewhere"
                doubts.append(f"{name[0].upper()}{name[1:]} {what}; write both with the header of one image.")
        if name != "the body":
            continue
        points = {
            bone: own.points()[:: 1 + np.count_nonzero(own.inside) // _SAMPLE] for bone, own in bones.items()
        }
        outside = [bone for bone, own in points.items() if (~mask.holds(own)).mean() > _OUTSIDE]
        if outside:
            (low, high), (least, most) = (
                (own[:, 2].min(), own[:, 2].max()) for own in (mask.corners(), np.vstack(list(points.values())))
            )
            what = f"The body, z {low:.0f} to {high:.0f} mm, does not hold {', '.join(outside[:5])}"
            more = f" and {len(outside) - 5} more" if len(outside) > 5 else ""
            doubts.append(
                f"{what}{more}; the labels have z {least:.0f} to {most:.0f} mm: is it of the same image?"
            )
    return doubts


def doubts_of_image(masks: Mapping[str, Mask], body: Mask | None, spine: Mapping[str, Surface]) -> list[str]:
    """A sentence for the bones that the image cuts off, and one for each side at which it cuts the trunk off.

    Args:
        masks: bones by name.
        body: the body, where it came from an image.
        spine: surfaces of vertebrae by name [mm].
    """
    cut = sorted(name for name, mask in masks.items() if mask.faces_at_border())
    doubts = [f"The image ends in {', '.join(cut)}: only the parts that it shows are there."] if cut else []
    if body is None:
        return doubts
    for axis, side in body.faces_at_border():
        direction = body.affine[:2, axis] / body.spacing[axis] * (1.0 if side else -1.0)
        if np.linalg.norm(direction) < 0.7:
            continue  # neck and thighs
        local = side * (body.shape[axis] - 1) - body.first[axis]
        where = np.argwhere(body.inside.take(local, axis=axis))
        area = len(where) * body.voxel_volume / float(body.spacing[axis])
        if area < _LEAST_BORDER_AREA:
            continue
        heights = body.place(np.insert(where, axis, local, axis=1))[:, 2]
        low, high = float(heights.min()), float(heights.max())
        levels = [n for n in VERTEBRAE if n in spine and low < float(spine[n].vertices[:, 2].mean()) < high]
        across = int(np.abs(direction).argmax())
        word = (("right", "left"), ("front", "back"))[across][int(direction[across] > 0.0)]
        flat = (
            f"its rotation from {levels[0]} to {levels[-1]} is not that of the patient" if levels else "it is flat"
        )
        doubts.append(
            f"The trunk is cut off by the {word} border of the image over {area / 100.0:.0f} cm2, from z = "
            f"{low:.0f} to {high:.0f} mm: {flat} there; reconstruct the scan with a larger field of view."
        )
    return doubts
