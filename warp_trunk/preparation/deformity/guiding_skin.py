"""How the skin of the lower back and of the shoulders follows a curve that grows: points that guide the spline."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

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
    for level in _LUMBAR:
        pose = poses[level]
        for point in _behind(skin, pose.before):
            c, s = np.cos(LUMBAR_SHARE * pose.rotation), np.sin(LUMBAR_SHARE * pose.rotation)
            x, y, z = point - pose.before
            before.append(point)
            after.append(pose.after + np.array([c * x - s * y, s * x + c * y, z]))
    outline = upper_outline(skin, spine_of(landmarks), asis_axis(landmarks))
    if outline is not None:
        way = poses["T1"].after - poses["T1"].before
        for left, higher in ((0, -0.5 * shoulders), (1, 0.5 * shoulders)):
            for vertex in np.unique(outline.ends[left, :, 0]):
                before.append(skin.vertices[vertex])
                after.append(skin.vertices[vertex] + way + [0.0, 0.0, higher])
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
