"""How skin, ribs, sternum and pelvis follow a spine that deforms: points that guide the spline."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.bone_motion.rib_cage import follow
from warp_trunk.bone_motion.vertebra_motion import Vertebra
from warp_trunk.case.rib_shares import RibShares
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures.shoulders import upper_outline
from warp_trunk.measures.spine import asis_axis, spine_of

from .spine_curve import Pose

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.geometry.surface import Surface

LUMBAR_SHARE = 0.5
"""Of a lumbar vertebra's axial rotation, what the skin behind it turns by. Inclination of the trunk and rotation
of the vertebra go together (r = 0.77, Carlson et al. 2013), and the back turns less than the vertebra; the ratio
is assumed."""
_LUMBAR = ("L1", "L2", "L3", "L4")
_BESIDE = 0.3
"""Where the muscles beside the lumbar spine bulge, over half the width of the trunk there."""


def guiding_skin(
    skin: Surface, landmarks: Landmarks, poses: Mapping[str, Pose], shoulders: float
) -> tuple[np.ndarray, np.ndarray]:
    """Points on the skin before and after the curve has grown, each (n, 3) [mm].

    Beside each of L1 to L4 the skin goes sideways with its vertebra and turns by `LUMBAR_SHARE` of it. The tops of
    both shoulders go with T1, and one stands higher than the other as in patients with such a curve, whose muscles
    hold the shoulders nearly level whatever T1 does. Nothing is guided where no vertebra moves.

    Args:
        skin: of the straight trunk.
        landmarks: of the straight bones.
        poses: motion of each vertebra by name.
        shoulders: how much higher the right shoulder comes to stand than it was against the left [mm].
    """
    before: list[np.ndarray] = []
    after: list[np.ndarray] = []
    if all(pose.still for pose in poses.values()):
        return np.empty((0, 3)), np.empty((0, 3))
    for pose in (poses[level] for level in _LUMBAR):
        c, s = np.cos(LUMBAR_SHARE * pose.rotation), np.sin(LUMBAR_SHARE * pose.rotation)
        for point in _behind(skin, pose.before):
            x, y, z = point - pose.before
            before.append(point)
            after.append(pose.after + np.array([c * x - s * y, s * x + c * y, z]))
    outline = upper_outline(skin, spine_of(landmarks), asis_axis(landmarks))
    if outline is not None:
        way = poses["T1"].after - poses["T1"].before
        for left, higher in ((0, -0.5 * shoulders), (1, 0.5 * shoulders)):
            for vertex in skin.vertices[np.unique(outline.ends[left, :, 0])]:
                before.append(vertex)
                after.append(vertex + way + [0.0, 0.0, higher])
    return np.array(before).reshape(-1, 3), np.array(after).reshape(-1, 3)


def _behind(skin: Surface, centre: np.ndarray) -> list[np.ndarray]:
    """The skin of the back at the height of a vertebra, on either side of it."""
    near = skin.vertices[np.abs(skin.vertices[:, 2] - centre[2]) < 10.0]
    if not len(near):
        return []
    half = 0.5 * np.ptp(near[:, 0])
    back = near[near[:, 1] > centre[1]]
    found = []
    for side in (-1.0, 1.0):
        beside = np.abs(back[:, 0] - centre[0] - side * _BESIDE * half)
        if len(beside) and beside.min() < 0.2 * half:
            found.append(back[beside.argmin()])
    return found


GROWTH = RibShares(recovery=1.0)
"""A curve grows with all of the shares that surgery takes back in part."""
PELVIS = ("hip_left", "hip_right", "sacrum")
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
    vertebrae = {name: Vertebra(pose.motion, np.array([pose.before, pose.axis])) for name, pose in poses.items()}
    motions = follow(bones, vertebrae, GROWTH, growing=True)
    if all(pose.still for pose in poses.values()):
        motions = dict.fromkeys(motions)
    before, after = [np.empty((0, 3))], [np.empty((0, 3))]
    for name, bone in bones.items():
        if name in motions or name in PELVIS:
            motion = motions.get(name)
            points = _spread(bone.vertices, bone.vertices.mean(axis=0), 14 if name in PELVIS else _POINTS_PER_BONE)
            before.append(points)
            after.append(points if motion is None else motion.apply(points))
    points, kept, taken = np.vstack(before), [], landmarks
    for i, point in enumerate(points):
        if np.linalg.norm(taken - point, axis=1).min(initial=np.inf) >= _APART:
            kept.append(i)
            taken = np.vstack([taken, point])
    return points[kept], np.vstack(after)[kept]


def _spread(vertices: np.ndarray, start: np.ndarray, count: int) -> np.ndarray:
    """Vertices far from each other, the first the nearest to `start`, shape (count, 3)."""
    chosen = [int(np.linalg.norm(vertices - start, axis=1).argmin())]
    gap = np.full(len(vertices), np.inf)
    while len(chosen) < min(count, len(vertices)):
        gap = np.minimum(gap, np.linalg.norm(vertices - vertices[chosen[-1]], axis=1))
        chosen.append(int(gap.argmax()))
    return vertices[chosen]
