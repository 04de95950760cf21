"""Checks of the image: bones and skin cut off by its border, and holes in labels."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from warp_trunk.case.landmarks import VERTEBRAE
from warp_trunk.geometry.surface import Surface

from .mask import Mask, largest_piece

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
                f"sacrum: has a hole of {hole / 100.0:.0f} cm2, as segmentation often leaves there; fill "
                "it, or soft tissue "
                "takes its place."
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
