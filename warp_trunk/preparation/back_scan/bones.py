"""The bones under a fitted skin: ribs on their vertebrae, and none nearer to the skin than it may be."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from warp_trunk.bone_motion.rib_cage import ends
from warp_trunk.case.anatomy import VERTEBRAE, rib_of
from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.surface import Surface, area_vectors, neighbour_means, unit

from ..deformity.spine_curve import VertebraPose

UNDER_SKIN = 3.0
"""No bone is nearer to the skin than this [mm]."""
MOST_FORWARD = 45.0
"""A vertebra that must go farther forward than this to lie under the skin is outside the body [mm]; in
20 patients, whose films and scans were registered, it was 35 at most."""
_HEAD = 30.0
"""A rib is bent over about this length to bring its head back onto its vertebra [mm]."""
_AROUND = 25.0
"""A bone is bent over about this length where it is pushed under the skin [mm]."""
_ROUNDS = 12


def ribs_on_vertebrae(
    bones: Mapping[str, Surface], straight: Mapping[str, Surface], poses: Mapping[str, VertebraPose]
) -> dict[str, Surface]:
    """The bones with the head of each rib where it lies on its vertebra in the straight body.

    Args:
        bones: carried, by name.
        straight: the same before, with the same vertices.
        poses: motion of each vertebra.
    """
    moved_bones = dict(bones)
    for name, bone in bones.items():
        rib = rib_of(name)
        level = rib.vertebra if rib else ""
        if level in straight:
            head = ends(straight[name], straight[level])[0]
            near = np.exp(-((np.linalg.norm(straight[name].vertices - head, axis=1) / _HEAD) ** 2))
            off = poses[level](straight[name].vertices) - bone.vertices
            moved_bones[name] = Surface(bone.vertices + near[:, None] * off, bone.faces)
    return moved_bones


def forward_under_skin(vertebrae: Mapping[str, Surface], skin: Surface, where: str) -> np.ndarray:
    """How far each of T1 to L5 goes forward so that its processes lie under the skin, smooth, shape (17,) [mm].

    Raises:
        InputError: a vertebra is farther outside the body than an error of films explains.
    """
    from scipy.ndimage import gaussian_filter1d, maximum_filter1d  # heavy

    distance, need = SurfaceDistance(skin), np.zeros(len(VERTEBRAE))
    for row, level in enumerate(VERTEBRAE):
        points = vertebrae[level].vertices
        while (out := float(distance.at(points - [0.0, need[row], 0.0]).max()) + UNDER_SKIN) > 0.0:
            need[row] += out + 0.2
            if need[row] > MOST_FORWARD:
                rule = f"{level} would have to go more than {MOST_FORWARD:g} mm forward to lie under the skin"
                cure = "give spine and scan in one frame, in mm and LPS"
                raise InputError(f"{where}: lies outside the body: {rule}; {cure}")
    wide = gaussian_filter1d(maximum_filter1d(need, 3, mode="nearest"), 1.0, mode="nearest")
    return np.maximum(wide, need) if need.any() else need


def under_skin(bone: Surface, distance: SurfaceDistance, facing: np.ndarray) -> Surface:
    """The bone bent inwards where it is nearer to the skin than `UNDER_SKIN`.

    Args:
        bone: near or partly outside the skin.
        distance: to the skin.
        facing: unit normals of the triangles of the skin.
    """
    from scipy.spatial import KDTree

    mean, vertices = neighbour_means(bone), bone.vertices
    for _ in range(_ROUNDS):
        near = distance.nearest(vertices)
        depth = -near.distance
        bad = np.flatnonzero(depth < UNDER_SKIN)
        if not len(bad):
            break
        push = -(UNDER_SKIN + 0.3 - depth[bad])[:, None] * facing[near.face[bad]]
        gap, nearest = KDTree(vertices[bad]).query(vertices)
        field = np.exp(-((np.asarray(gap) / _AROUND) ** 2))[:, None] * push[nearest]
        for _ in range(10):
            field = mean @ field
        vertices = vertices + 1.2 * field
    return Surface(vertices, bone.faces)


def all_under_skin(bones: Mapping[str, Surface], skin: Surface, fixed: tuple[str, ...]) -> dict[str, Surface]:
    """The bones, all but those kept bent under the skin where they must (`under_skin`)."""
    distance, facing = SurfaceDistance(skin), unit(area_vectors(skin.vertices, skin.faces))
    return {name: bone if name in fixed else under_skin(bone, distance, facing) for name, bone in bones.items()}
