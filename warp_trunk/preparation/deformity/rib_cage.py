"""How ribs, sternum and pelvis follow a deformed spine: points that guide the spline beside the landmarks."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from warp_trunk.bone_motion.rib_cage import follow
from warp_trunk.bone_motion.vertebra_motion import split
from warp_trunk.case.rib_shares import RibShares
from warp_trunk.geometry.surface import Surface

from .spine_curve import Pose

GROWTH = RibShares(recovery=1.0)
"""A curve grows with all of the shares that surgery takes back in part."""
_PELVIS = ("hip_left", "hip_right", "sacrum")
_POINTS_PER_BONE = 5
_APART = 8.0
"""Guiding points nearer than this to another or a landmark are left out [mm]: they would ask for a shear."""


def guiding_points(
    bones: Mapping[str, Surface], poses: Mapping[str, Pose], landmarks: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Points on ribs, sternum and pelvis before and after the spine's motion, each (n, 3) [mm].

    Ribs and sternum follow the vertebrae as they do in surgery (`bone_motion.rib_cage.follow`), with all of the
    shares; hip bones and sacrum stay. Bones that are missing guide nothing.

    Args:
        bones: surfaces by name, before: `rib_left_01` to `rib_right_12`, `sternum`, `hip_left`, `hip_right`,
            `sacrum`, and the vertebrae of the ribs.
        poses: motion of each vertebra by name.
        landmarks: points the spline already holds, (m, 3) [mm].
    """
    moving = {name: pose for name, pose in poses.items() if not pose.still}
    vertebrae = {name: split(pose.motion, pose.before, pose.axis) for name, pose in poses.items()}
    motions = follow(bones, vertebrae, GROWTH, growing=True)
    before, after = [np.empty((0, 3))], [np.empty((0, 3))]
    for name, bone in bones.items():
        if name not in motions and name not in _PELVIS:
            continue
        count = 14 if name in _PELVIS else _POINTS_PER_BONE
        points = _spread(bone.vertices, bone.vertices.mean(axis=0), count)
        before.append(points)
        after.append(motions[name].apply(points) if name in motions and moving else points)
    return _thin(np.vstack(before), np.vstack(after), landmarks)


def _spread(vertices: np.ndarray, start: np.ndarray, count: int) -> np.ndarray:
    """Vertices far from each other, the first the nearest to `start`, shape (count, 3)."""
    chosen = [int(np.linalg.norm(vertices - start, axis=1).argmin())]
    gap = np.full(len(vertices), np.inf)
    while len(chosen) < min(count, len(vertices)):
        gap = np.minimum(gap, np.linalg.norm(vertices - vertices[chosen[-1]], axis=1))
        chosen.append(int(gap.argmax()))
    return vertices[chosen]


def _thin(before: np.ndarray, after: np.ndarray, landmarks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    kept: list[int] = []
    taken = landmarks
    for i, point in enumerate(before):
        if np.linalg.norm(taken - point, axis=1).min(initial=np.inf) >= _APART:
            kept.append(i)
            taken = np.vstack([taken, point])
    return before[kept], after[kept]
