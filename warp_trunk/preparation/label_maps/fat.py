"""How thick the fat under the skin is, from its mask in an image."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from warp_trunk.case.layers import SKIN_THICKNESS
from warp_trunk.errors import InputError
from warp_trunk.geometry.cutting import CutPlane
from warp_trunk.geometry.distance_field import nearest
from warp_trunk.geometry.surface import Surface, vertex_normals

from .mask import Mask

_REACH = 120.0
"""The fat is followed to this depth [mm]."""
_RAY_STEP = 0.25
"""Between two points of a ray [mm]."""
_BEGINS = 8.0
"""Fat that begins deeper than this under the skin is not that under the skin [mm]."""
_GAP = 3.0
"""Voxels that are no fat over less than this along a ray are vessels and the noise of a segmentation, unless they
are muscle [mm]."""
_FLAT = 0.5
"""Triangles whose corners lie nearer than this to a plane of a cut are part of a flat end [mm]."""


def fat_thickness(
    skin: Surface, fat: Mask, muscle: Mask | None, cuts: Sequence[CutPlane]
) -> tuple[np.ndarray, np.ndarray]:
    """Follow a ray from each vertex of the skin inward to the end of the fat, and return the depth of that point.

    Masks are taken as linear between the centres of voxels, so that thickness does not come in steps of a voxel.
    A skin of `SKIN_THICKNESS`, which no such image shows, lies above the fat; where the fat ends above its lower
    side there is none.

    Args:
        skin: closed, oriented outward [mm].
        fat: the fat between skin and muscles.
        muscle: the muscles, which end the fat wherever they begin.
        cuts: where the trunk was cut flat: there is no skin.

    Returns:
        The thickness at each vertex, from the lower side of the skin to that of the fat [mm], and whether it was
        measured there, shape (vertices,) each; elsewhere, on flat ends and beyond the masks, it is the median.

    Raises:
        InputError: the masks reach no part of the skin.
    """
    flat = [(np.abs(plane.distance(skin.vertices)) < _FLAT)[skin.faces].all(axis=1) for plane in cuts]
    real = Surface(skin.vertices, skin.faces[~np.any(flat, axis=0)] if flat else skin.faces)
    normals = vertex_normals(real)
    measured = (np.linalg.norm(normals, axis=1) > 0.5) & reached(
        skin.vertices, [fat] if muscle is None else [fat, muscle]
    )
    if not measured.any():
        raise InputError("import: the masks of fat and muscle reach no part of the body; give those of this image")
    depths = np.arange(0.0, _REACH + _RAY_STEP, _RAY_STEP)
    ends = np.zeros(len(skin.vertices))
    for some in np.array_split(np.flatnonzero(measured), max(1, len(ends) // 2000)):  # for the memory
        points = skin.vertices[some, None] - depths[:, None] * normals[some, None]
        is_fat = fat.holds(points)
        ends[some] = _ends(is_fat, np.zeros_like(is_fat) if muscle is None else muscle.holds(points) & ~is_fat)
    bottoms = skin.vertices - ends[:, None] * normals
    face, weights = nearest(real, bottoms, _REACH)  # as deep as layers are meshed: in folds and at rims less
    above = np.einsum("nc,ncx->nx", weights, real.vertices[real.faces[face]])
    thickness = np.maximum(np.linalg.norm(bottoms - above, axis=1) - SKIN_THICKNESS, 0.0)
    thickness[~measured] = np.median(thickness[measured])
    return thickness, measured


def reached(points: np.ndarray, masks: Sequence[Mask]) -> np.ndarray:
    """Which points (n, 3) lie in the box around some masks of one image, or near it."""
    corners = np.vstack([(mask.part(mask.inside) or mask).corners() for mask in masks])
    return ((points > corners.min(axis=0) - _BEGINS) & (points < corners.max(axis=0) + _BEGINS)).all(axis=1)


def _ends(fat: np.ndarray, muscle: np.ndarray) -> np.ndarray:
    """The depth at which the fat ends along each ray [mm], 0 where there is none; both (rays, points), bool."""
    steps = np.arange(fat.shape[1])
    since = steps - np.maximum.accumulate(np.where(fat, steps, -1), axis=1)  # points since the last fat
    first = fat.argmax(axis=1)
    over = (steps > first[:, None]) & ((since * _RAY_STEP > _GAP) | muscle)
    end = np.where(over.any(axis=1), over.argmax(axis=1), fat.shape[1] - 1)
    last = end - since[np.arange(len(fat)), end]
    return np.where(fat.any(axis=1) & (first * _RAY_STEP <= _BEGINS), (last + 0.5) * _RAY_STEP, 0.0)
