"""The anterior superior iliac spines."""

from __future__ import annotations

import numpy as np

from warp_trunk.geometry.surface import Surface

_MOST_PITCH = 40.0
"""Of the anterior pelvic plane against the vertical of a standing patient [deg]."""
_LEAST_HEIGHT = 40.0
"""From the pubis to the iliac spines of a whole pelvis [mm]; with less, its plane cannot be determined."""


def iliac_spines(hip_left: Surface, hip_right: Surface) -> np.ndarray:
    """The anterior superior iliac spines, left and right, shape (2, 3) [mm].

    They and the pubis are the places that touch a plane laid against the pelvis from the front (the anterior
    pelvic plane), so that they do not change when the patient leans. Starts in patient axes (LPS) and takes, in
    turn, the front of the upper and of the lower half of each hip bone and the axes that they make. Where hip
    bones hold no pubis, only the turn about the vertical and the sideways lean are followed.
    """
    axes = np.eye(3)
    spines = np.zeros((2, 3))
    for _ in range(20):
        before = spines
        spines, pubis = (_fronts(hip_left, hip_right, axes, upper) for upper in (True, False))
        if (spines == before).all():
            break
        left = spines[0] - spines[1]
        left /= np.linalg.norm(left)
        up = spines.mean(axis=0) - pubis.mean(axis=0)
        pitch = np.degrees(np.arctan2(abs(up[1]), up[2]))
        if up[2] < _LEAST_HEIGHT or pitch > _MOST_PITCH:
            up = np.array([0.0, 0.0, 1.0])
        up -= (up @ left) * left
        up /= np.linalg.norm(up)
        axes = np.stack([left, np.cross(up, left), up])
    return spines


def _fronts(hip_left: Surface, hip_right: Surface, axes: np.ndarray, upper: bool) -> np.ndarray:
    found = []
    for hip in (hip_left, hip_right):
        local = hip.vertices @ axes.T
        above = local[:, 2] > (local[:, 2].min() + local[:, 2].max()) / 2.0
        half = above if upper else ~above
        found.append(hip.vertices[half][local[half, 1].argmin()])
    return np.array(found)
