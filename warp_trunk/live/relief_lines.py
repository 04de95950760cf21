"""Lines of equal depth on the back, as on a relief map; they show a hump as one sees it in slanting light."""

from __future__ import annotations

import numpy as np

STEP = 5.0
"""From one line to the next [mm]."""
_FACING = 0.5
"""Where the skin faces back by less than this (a cosine: 60 degrees), it is flank and lines would run together."""
_LIFT = 0.6
"""Lines lie so far in front of the skin that they are seen [mm]."""


def relief_lines(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Where planes of equal depth (y), `STEP` apart, cut the part of a skin that faces back.

    Args:
        vertices: of the skin [mm], shape (vertices, 3); float32 is enough, and faster.
        faces: its triangles, shape (faces, 3).

    Returns:
        Ends of line segments [mm], shape (segments, 2, 3), of the type of the vertices.
    """
    depth = vertices[:, 1] / vertices.dtype.type(STEP)
    corners = np.ascontiguousarray(faces.T)  # by corner: each step below goes along rows
    below = np.floor(depth).astype(np.int32)
    a, b, c = (below.take(corner) for corner in corners)
    low = np.minimum(np.minimum(a, b), c)
    count = np.maximum(np.maximum(a, b), c) - low
    cut = np.flatnonzero(count)
    cut = cut[_face_back(vertices, corners[:, cut])]
    low, count = low[cut], count[cut]
    level = np.repeat(1 + low - np.cumsum(count) + count, count) + np.arange(count.sum())
    return _segments(vertices, depth, corners[:, np.repeat(cut, count)], level.astype(depth.dtype))


def _face_back(vertices: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Whether triangles, by corner (3, triangles), face back."""
    (ax, bx, cx), (ay, by, cy), (az, bz, cz) = (along.take(corners) for along in vertices.T)
    ux, uy, uz, vx, vy, vz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return y > _FACING * np.sqrt(x * x + y * y + z * z)


def _segments(vertices: np.ndarray, depth: np.ndarray, corners: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Where each triangle (3, segments) is cut by one plane, in steps of depth, that has corners on both sides."""
    first, second, third = depth.take(corners) >= level
    alone = np.where(first == second, 2, np.where(first == third, 1, 0))  # the corner on a side of its own
    start, left, right = np.take_along_axis(corners, (alone + np.arange(3)[:, None]) % 3, axis=0)
    origin, here = vertices.take(start, axis=0), depth.take(start)
    ends = np.empty((len(level), 2, 3), vertices.dtype)
    for side, end in enumerate((left, right)):
        share = (level - here) / (depth.take(end) - here)
        ends[:, side] = origin + share[:, None] * (vertices.take(end, axis=0) - origin)
    ends[:, :, 1] += _LIFT
    return ends
