"""Closed surfaces from analytic sections: tubes along a curve, and stacks of horizontal loops."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from warp_trunk.geometry.surface import Surface


def tube(
    centres: np.ndarray,
    side: np.ndarray,
    up: np.ndarray,
    half_side: np.ndarray,
    half_up: np.ndarray,
    *,
    around: int = 12,
    exponent: float = 2.0,
) -> Surface:
    """A closed surface through superelliptic rings, with a point at each end.

    Ring k holds the vertices 1 + k * around + j, at angle 2 pi j / around from `side` towards `up`. The first
    vertex and the last are the ends; the first and the last centre stand for them, and their half widths are
    not used. The tube runs along side x up.

    Args:
        centres: shape (rings + 2, 3) [mm].
        side: unit vectors across the tube, shape (rings + 2, 3).
        up: unit vectors across both, shape (rings + 2, 3).
        half_side: half widths along `side` [mm], shape (rings + 2,).
        half_up: half widths along `up` [mm], shape (rings + 2,).
        around: vertices of a ring.
        exponent: 2 is an ellipse, more is closer to a rectangle.
    """
    angle = 2.0 * np.pi * np.arange(around) / around
    c, s = np.cos(angle), np.sin(angle)
    c, s = (np.sign(f) * np.abs(np.round(f, 15)) ** (2.0 / exponent) for f in (c, s))
    inner = slice(1, -1)
    rings = (
        centres[inner, None]
        + (half_side[inner, None] * c)[..., None] * side[inner, None]
        + (half_up[inner, None] * s)[..., None] * up[inner, None]
    )
    count = len(centres) - 2
    vertices = np.concatenate([centres[:1], rings.reshape(-1, 3), centres[-1:]])
    j, k = np.arange(around), (np.arange(around) + 1) % around
    faces = [np.stack([np.zeros_like(j), 1 + k, 1 + j], axis=1)]
    for ring in range(count - 1):
        here, there = 1 + ring * around, 1 + (ring + 1) * around
        faces.append(np.stack([here + j, here + k, there + k], axis=1))
        faces.append(np.stack([here + j, there + k, there + j], axis=1))
    last = 1 + (count - 1) * around
    faces.append(np.stack([last + j, last + k, np.full_like(j, len(vertices) - 1)], axis=1))
    return Surface(vertices, np.concatenate(faces).astype(np.int32))


def rod(
    guide: np.ndarray,
    half_side: np.ndarray,
    half_up: np.ndarray,
    up: np.ndarray,
    spacing: float,
    *,
    around: int = 10,
) -> Surface:
    """A tube with rounded ends along a smooth curve through guiding points.

    Args:
        guide: points the curve goes through, the first and the last the ends, shape (n, 3) [mm].
        half_side: half widths at these points across `up` [mm], shape (n,).
        half_up: half widths at these points along `up` [mm], shape (n,).
        up: direction of `half_up`, as near as can be, shape (3,).
        spacing: wanted distance between rings [mm].
        around: vertices of a ring.
    """
    from scipy.interpolate import CubicSpline, PchipInterpolator  # heavy

    chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(guide, axis=0), axis=1))])
    fine = np.linspace(0.0, chord[-1], 400)
    curve = CubicSpline(chord, guide)(fine)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    cap = float(half_side[0] + half_side[-1]) / 2.0  # ends are half ellipsoids of this length
    caps = cap * np.array([0.0, 0.12, 0.5])
    middle = np.linspace(cap, length[-1] - cap, max(2, 1 + round((length[-1] - 2.0 * cap) / spacing)))
    places = np.concatenate([caps, middle, length[-1] - caps[::-1]])
    to_end = np.minimum(places, length[-1] - places)
    share = np.sqrt(1.0 - np.clip(1.0 - to_end / cap, 0.0, 1.0) ** 2)
    centres = np.stack([np.interp(places, length, column) for column in curve.T], axis=1)
    forward = np.gradient(centres, axis=0)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    across = up - (forward @ up)[:, None] * forward
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    side = np.cross(across, forward)
    widths = PchipInterpolator(chord, np.stack([half_side, half_up], axis=1))(np.interp(places, length, fine))
    return tube(centres, side, across, share * widths[:, 0], share * widths[:, 1], around=around)


def stack(half_loops: Sequence[np.ndarray]) -> Surface:
    """A closed surface, its own mirror image in x = 0, from the left halves of loops.

    Each half loop runs from behind (x = 0) by the left (x > 0) to the front (x = 0), and all have their
    points in the order of the angle about a centre of their own. Neighbours are joined by triangles and the
    first and the last may be single points, so loops that shrink to a point in one plane close an end.
    Loops in planes one above the other give a surface that cannot cross itself: a slice between two planes
    holds blends of their points in the order of their angles.

    Args:
        half_loops: points, each (n, 3) with n >= 2, or (1, 3) for an end [mm]; from the top down.
    """
    starts = np.cumsum([0, *(len(loop) for loop in half_loops)])
    vertices = np.concatenate(half_loops)
    faces = []
    for k, (upper, lower) in enumerate(pairwise(half_loops)):
        i = j = 0
        while i < len(upper) - 1 or j < len(lower) - 1:  # by the shorter diagonal at each step
            step_up = np.linalg.norm(upper[i + 1] - lower[j]) if i < len(upper) - 1 else np.inf
            step_down = np.linalg.norm(upper[i] - lower[j + 1]) if j < len(lower) - 1 else np.inf
            one, other = starts[k] + i, starts[k + 1] + j
            faces.append((one, one + 1, other) if step_up <= step_down else (one, other + 1, other))
            i, j = (i + 1, j) if step_up <= step_down else (i, j + 1)
    left = np.array(faces)
    on_plane = vertices[:, 0] == 0.0
    mirror = np.arange(len(vertices))
    mirror[~on_plane] = len(vertices) + np.arange((~on_plane).sum())
    both = np.concatenate([vertices, vertices[~on_plane] * [-1.0, 1.0, 1.0]])
    return Surface(both, np.concatenate([left, mirror[left][:, ::-1]]).astype(np.int32))


def spaced(curve: np.ndarray, count: int) -> np.ndarray:
    """`count` points at equal arc length along a polyline, ends kept, shape (count, 3)."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    places = np.linspace(0.0, length[-1], count)
    points = np.stack([np.interp(places, length, column) for column in curve.T], axis=1)
    points[0], points[-1] = curve[0], curve[-1]
    return points
