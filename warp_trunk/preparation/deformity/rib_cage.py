"""How ribs, sternum and pelvis follow a deformed spine: points that guide the spline beside the landmarks."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.geometry.surface import Surface

from .spine_curve import Pose

_RIB = re.compile(r"rib_(left|right)_(0[1-9]|1[0-2])")
_POINTS_PER_BONE = 7
_APART = 8.0
"""Guiding points nearer than this to another or a landmark are left out [mm]: they would ask for a shear."""

# What of the spine's motion reaches a rib, by its distance q from the body, 1 at the front of the cage. Ribs
# turn in their joints and bend: a hump is smaller than the rotation of its vertebra. With these shares an adult
# trunk gets a back surface rotation of 0.2 of the Cobb angle, about the size of the rib humps of Mattila et al.
# 2013 (Spine): 12 degrees at 56 degrees Cobb.
_LEAN_LOST = 4.0
"""The rib leans by 1 / (1 + this q) of the coronal tilt of its vertebra."""
_SHIFT_LOST = 0.5
"""The rib shifts sideways by 1 - this q of the spine's shift at the same height."""


def guiding_points(
    bones: Mapping[str, Surface], poses: Mapping[str, Pose], landmarks: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Points on ribs, sternum and pelvis before and after the spine's motion, each (n, 3) [mm].

    A rib follows its own vertebra, the less the further from the spine; the sternum follows the front ends of
    the ribs 1 to 7 as one rigid body; hip bones and sacrum stay. Bones that are missing guide nothing.

    Args:
        bones: surfaces by name, before: `rib_left_01` to `rib_right_12`, `sternum`, `hip_left`, `hip_right`,
            `sacrum`.
        poses: motion of each vertebra by name.
        landmarks: points the spline already holds, (m, 3) [mm].
    """
    ribs = {name: f"T{int(name[-2:])}" for name in bones if _RIB.fullmatch(name)}
    reach = max((_reach(bones[rib].vertices, poses[v]).max() for rib, v in ribs.items()), default=1.0)
    before, after = [], []
    front: list[tuple[np.ndarray, np.ndarray]] = []
    for rib, vertebra in ribs.items():
        pose = poses[vertebra]
        points = _spread(bones[rib].vertices, pose.before, _POINTS_PER_BONE)
        moved = _follow(points, pose, poses, reach)
        before.append(points)
        after.append(moved)
        if int(vertebra[1:]) <= 7:
            tip = int(_reach(points, pose).argmax())
            front.append((points[tip], moved[tip]))
    if "sternum" in bones:
        points = _spread(bones["sternum"].vertices, bones["sternum"].vertices.mean(axis=0), _POINTS_PER_BONE)
        before.append(points)
        after.append(_carry_rigidly(points, front))
    for name in ("hip_left", "hip_right", "sacrum"):
        if name in bones:
            vertices = bones[name].vertices
            points = _spread(vertices, vertices.mean(axis=0), 2 * _POINTS_PER_BONE)
            before.append(points)
            after.append(points)
    if not before:
        return np.empty((0, 3)), np.empty((0, 3))
    return _thin(np.vstack(before), np.vstack(after), landmarks)


def _reach(points: np.ndarray, pose: Pose) -> np.ndarray:
    return np.linalg.norm((points - pose.before)[:, :2], axis=1)


def _follow(points: np.ndarray, vertebra: Pose, poses: Mapping[str, Pose], reach: float) -> np.ndarray:
    """Points of a rib: shifted with the spine at their own height, turned and tilted with their vertebra.

    Shifting by height, not by vertebra, keeps neighbouring ribs apart where they slope far down.
    """
    spine = sorted(poses.values(), key=lambda pose: pose.before[2])
    heights = [pose.before[2] for pose in spine]
    x, z = (np.interp(points[:, 2], heights, [(p.after - p.before)[axis] for p in spine]) for axis in (0, 2))
    q = _reach(points, vertebra) / reach
    turn = vertebra.rotation * (1.0 - q**2)
    lean = vertebra.tilt / (1.0 + _LEAN_LOST * q)
    dx, dy = (points - vertebra.before)[:, :2].T
    across = np.cos(turn) * dx - np.sin(turn) * dy
    back = np.sin(turn) * dx + np.cos(turn) * dy
    turned = np.column_stack([np.cos(lean) * across - dx, back - dy, -np.sin(lean) * across])
    return points + turned + np.column_stack([x * (1.0 - _SHIFT_LOST * q), np.zeros_like(x), z])


def _carry_rigidly(points: np.ndarray, pairs: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Points moved by the rigid motion nearest to the pairs; left alone with fewer than three."""
    a, b = (np.array([pair[side] for pair in pairs]) for side in (0, 1))
    if len(pairs) < 3 or (a == b).all():  # not even a rounding where nothing moves
        return points.copy()
    return fit_rigid(a, b).apply(points)


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
