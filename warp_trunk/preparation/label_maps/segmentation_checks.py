"""Checks of a segmentation and of its image: common faults and what is cut off, each with the cure."""

from __future__ import annotations

from collections.abc import Container, Mapping
from itertools import pairwise

import numpy as np

from warp_trunk.case.landmarks import VERTEBRAE
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import enclosed_volume

from .mask import Mask, largest_piece
from .names import RIB

_LARGER, _SMALLER = 1.7, 0.5
"""Volume of a vertebra over the median of its neighbours', which grow by a tenth from one to the next."""
_WIDER = 1.6
"""Distance between two neighbours over the median of those around."""
_FROM_VERTEBRA = 8.0
"""The head of a rib is nearer to its vertebra than this [mm]: 3 mm at most in the anatomy of BodyParts3D."""
_ALIKE = 3
"""If this many ribs of a side lie at another vertebra than their number states, the numbering is wrong."""
_CURE = "Correct the labels, in 3D Slicer for example"


def doubts_of_bones(bones: Mapping[str, Surface], parts: Container[str] = ()) -> list[str]:
    """A sentence with the cure for each doubtful bone of a segmentation.

    Args:
        bones: surfaces by name, in LPS [mm].
        parts: those that the image cuts off, whose size and ends say nothing.
    """
    spine = {name: bones[name] for name in VERTEBRAE if name in bones and name not in parts}
    ribs = {name: bone for name, bone in bones.items() if name not in parts}
    return [*_sides(bones), *_numbers(bones), *_sizes(spine), *_spacing(spine), *_ribs(ribs, spine)]


def _sides(bones: Mapping[str, Surface]) -> list[str]:
    """Pairs whose left bone lies right of the right one."""
    pairs = [(name, name.replace("left", "right")) for name in bones if "left" in name]
    pairs = [(left, right) for left, right in pairs if right in bones]
    wrong = [
        left for left, right in pairs if bones[left].vertices[:, 0].mean() <= bones[right].vertices[:, 0].mean()
    ]
    if wrong and len(wrong) == len(pairs):
        return [
            f"Left and right are exchanged in all {len(pairs)} pairs of bones: the axes of the file are "
            "mirrored, or the names; write the file again with its orientation, and look where the heart is."
        ]
    return [f"{name}: lies right of {name.replace('left', 'right')}; exchange these two labels." for name in wrong]


def _numbers(bones: Mapping[str, Surface]) -> list[str]:
    """More or fewer ribs and vertebrae than usual."""
    doubts = []
    more = [name for name in bones if name in ("T13", "L6") or name.endswith("_13")]
    if more:
        doubts.append(
            f"{', '.join(sorted(more))}: one more than most people have; look whether the numbering is shifted. "
            "It stays a bone, and has no landmarks."
        )
    for side in ("left", "right"):
        have = {int(m[2]) for m in map(RIB.fullmatch, bones) if m and m[1] == side}
        missing = sorted(set(range(1, 13)) - have)
        if have and missing:
            names = ", ".join(map(str, missing))
            doubts.append(
                f"Of the {side} ribs number {names} has no label: cut off by the image, not there in this "
                "patient, or numbered wrong; look which."
            )
    return doubts


def _sizes(spine: Mapping[str, Surface]) -> list[str]:
    """Vertebrae much larger or smaller than their neighbours."""
    volumes = {name: enclosed_volume(bone) for name, bone in spine.items()}
    doubts = []
    for name, volume in volumes.items():
        at = VERTEBRAE.index(name)
        near = [volumes[n] for n in VERTEBRAE[max(0, at - 2) : at + 3] if n in volumes and n != name]
        if len(near) < 2:
            continue
        share = volume / float(np.median(near))
        if share > _LARGER:
            doubts.append(
                f"{name}: is {share:.1f} times as large as its neighbours; are two vertebrae in it? {_CURE}."
            )
        if share < _SMALLER:
            doubts.append(
                f"{name}: has {100 * share:.0f} % of its neighbours' volume; is a part of it in another "
                f"label? {_CURE}."
            )
    return doubts


def _spacing(spine: Mapping[str, Surface]) -> list[str]:
    """Numbers that jump where no bone is left out, and bones left out where no number is."""
    if len(spine) < 4:
        return []
    centres = {name: bone.vertices.mean(axis=0) for name, bone in spine.items()}
    gaps = {(a, b): float(np.linalg.norm(centres[a] - centres[b])) for a, b in pairwise(spine)}
    steps = {pair: VERTEBRAE.index(pair[1]) - VERTEBRAE.index(pair[0]) for pair in gaps}
    doubts = []
    pairs = list(gaps)
    for i, pair in enumerate(pairs):
        around = [gaps[p] / steps[p] for p in pairs[max(0, i - 2) : i + 3] if p != pair]
        share = gaps[pair] / float(np.median(around))
        if steps[pair] == 1 and share > _WIDER:
            doubts.append(
                f"{pair[0]} and {pair[1]}: are {share:.1f} times as far apart as their neighbours; is a vertebra "
                f"between them without a label, and the numbers below it shifted? {_CURE}."
            )
        if steps[pair] > 1 and share < 0.5 * (1 + steps[pair]):
            left_out = ", ".join(VERTEBRAE[VERTEBRAE.index(pair[0]) + 1 : VERTEBRAE.index(pair[1])])
            doubts.append(
                f"{pair[0]} and {pair[1]}: are as near as neighbours, though {left_out} would be between them; "
                "this patient has fewer vertebrae, or the numbers jump. Look which, and number them as they are "
                "counted."
            )
    return doubts


def _ribs(bones: Mapping[str, Surface], spine: Mapping[str, Surface]) -> list[str]:
    """Ribs away from their vertebrae, or at others."""
    from scipy.spatial import KDTree  # heavy

    levels = [name for name in spine if name[0] == "T"]
    if not levels:
        return []
    every = KDTree(np.vstack([spine[name].vertices for name in levels]))
    owner = [name for name in levels for _ in spine[name].vertices]
    trees = {name: KDTree(spine[name].vertices) for name in levels}
    shifts: dict[str, dict[int, int]] = {"left": {}, "right": {}}
    doubts = []
    for name in sorted(bones):
        found = RIB.fullmatch(name)
        number = int(found[2]) if found else 0
        if not found or f"T{number}" not in trees:
            continue
        points = bones[name].vertices
        away = float(trees[f"T{number}"].query(points)[0].min())
        if away <= _FROM_VERTEBRA:
            continue
        distances, nearest = every.query(points)
        at = int(owner[int(np.asarray(nearest)[np.argmin(distances)])][1:])
        if at not in (number - 1, number):
            shifts[found[1]][number] = at
        else:
            doubts.append(
                f"{name}: ends {away:.0f} mm from T{number}; its head is missing from the label. {_CURE}."
            )
    for side, moved in shifts.items():
        if len(moved) >= _ALIKE:
            doubts.append(
                f"The {side} ribs {', '.join(map(str, moved))} lie at T{', T'.join(map(str, moved.values()))}: "
                f"their numbers, or those of the vertebrae, are shifted. {_CURE}."
            )
        else:
            doubts += [
                f"rib_{side}_{number:02d}: lies at T{at}, not at T{number}; is it numbered wrong? {_CURE}."
                for number, at in moved.items()
            ]
    return doubts


_HOLE = 250.0
"""A hole in the sacrum larger than this is none of its foramina [mm2]."""
_CELL = 3.5
"""Size of the cells of the picture in which holes are looked for [mm]; larger than the sides of voxels."""
_LEAST = 400.0
"""A smaller part of the skin at the border is a corner of the image [mm2]."""


def doubts_of_image(masks: Mapping[str, Mask], body: Mask | None, spine: Mapping[str, Surface]) -> list[str]:
    """A sentence with the cure for each bone that the image cuts off and each label with a hole.

    Args:
        masks: bones by name.
        body: the body, where it came from an image.
        spine: surfaces of vertebrae by name [mm].
    """
    doubts = []
    cut = [name for name, mask in masks.items() if mask.faces_at_border()]
    if cut:
        doubts.append(f"The image ends in {', '.join(sorted(cut))}: only the parts that it shows are there.")
    if body is not None:
        doubts += _skin_cut_off(body, spine)
    if "sacrum" in masks:
        hole = _hole(masks["sacrum"])
        if hole > _HOLE:
            doubts.append(
                f"sacrum: has a hole of {hole / 100.0:.0f} cm2, as segmentation often leaves there; fill it, or "
                "soft tissue takes its place."
            )
    return doubts


def _skin_cut_off(body: Mask, spine: Mapping[str, Surface]) -> list[str]:
    """Where the body goes on to the left, right, front or back of the image."""
    doubts = []
    for axis, side in body.faces_at_border():
        direction = body.affine[:3, axis] / body.spacing[axis] * (1.0 if side else -1.0)
        if abs(direction[2]) > 0.7:
            continue  # neck and thighs
        local = (0 if side == 0 else body.shape[axis] - 1) - body.first[axis]
        where = np.argwhere(body.inside.take(local, axis=axis))
        area = len(where) * body.voxel_volume / float(body.spacing[axis])
        if area < _LEAST:
            continue
        heights = body.place(np.insert(where, axis, local, axis=1))[:, 2]
        low, high = float(heights.min()), float(heights.max())
        levels = [name for name in VERTEBRAE if name in spine and low < _height(spine[name]) < high]
        what = {0: ("left", "right"), 1: ("back", "front")}[int(np.abs(direction[:2]).argmax())]
        word = what[0 if direction[np.abs(direction[:2]).argmax()] > 0.0 else 1]
        affected = (
            f"back surface rotation from {levels[0]} to {levels[-1]} is not that of the patient"
            if levels
            else "no vertebra lies at that height"
        )
        doubts.append(
            f"The trunk is cut off by the {word} border of the image over {area / 100.0:.0f} cm2, from z "
            f"= {low:.0f} to "
            f"{high:.0f} mm: {affected}, and it is flat there; reconstruct the scan with a larger field of view."
        )
    return doubts


def _height(bone: Surface) -> float:
    return float(bone.vertices[:, 2].mean())


def _hole(mask: Mask) -> float:
    """Area of the largest hole that one looks through along the thinnest direction of a label [mm2]."""
    from scipy import ndimage  # heavy

    points = mask.points()
    points -= points.mean(axis=0)
    _, axes = np.linalg.eigh(points.T @ points)  # thinnest first
    flat = np.floor(points @ axes[:, 1:] / _CELL).astype(int)
    flat -= flat.min(axis=0)
    seen = np.zeros(flat.max(axis=0) + 1, dtype=bool)
    seen[tuple(flat.T)] = True
    holes = np.asarray(ndimage.binary_fill_holes(seen)) & ~seen
    return float(largest_piece(holes[..., None])[1][0]) * _CELL**2 if holes.any() else 0.0
