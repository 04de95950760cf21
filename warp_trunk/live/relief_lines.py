"""Lines of equal depth on the back, as on a relief map; they show a hump as one sees it in slanting light."""

from __future__ import annotations

import numpy as np

STEP = 5.0
"""From one line to the next [mm]."""
_FACING = 0.15
"""Skin that faces back by less than this is no back (cosine)."""
_LIFT = 0.6
"""Lines lie so far in front of the skin that they are seen [mm]."""


def relief_lines(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Where planes of equal depth (y), `STEP` apart, cut the part of a skin that faces back.

    Args:
        vertices: of the skin [mm], shape (vertices, 3).
        faces: its triangles, shape (faces, 3).

    Returns:
        Ends of line segments [mm], shape (segments, 2, 3).
    """
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    corners = corners[normal[:, 1] > _FACING * np.linalg.norm(normal, axis=1)]
    depth = corners[:, :, 1] / STEP
    low, high = np.floor(depth.min(axis=1)).astype(int), np.floor(depth.max(axis=1)).astype(int)
    count = high - low
    triangle = np.repeat(np.arange(len(corners)), count)
    level = 1 + low[triangle] + np.arange(len(triangle)) - np.repeat(np.cumsum(count) - count, count)
    here, points = depth[triangle], corners[triangle]
    above = here >= level[:, None]
    alone = np.argmax(above == (above.sum(axis=1) == 1)[:, None], axis=1)  # the corner on a side of its own
    row = np.arange(len(triangle))
    ends = []
    for other in (1, 2):
        next_one = (alone + other) % 3
        a, b = here[row, alone], here[row, next_one]
        share = ((level - a) / (b - a))[:, None]
        ends.append(points[row, alone] + share * (points[row, next_one] - points[row, alone]))
    return np.stack(ends, axis=1) + np.array([0.0, _LIFT, 0.0])
