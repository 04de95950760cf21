"""The skin of the phantom: superelliptic sections from neck to hips, with shoulders, waist and spinal groove.

All lengths are those of an adolescent girl, 575 mm from the hips to the neck; `phantom.py` scales.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from warp_trunk.geometry.section import arc_length, points_along
from warp_trunk.geometry.surface import Surface

EDGE = 12.5
"""Wanted edge length of the skin [mm]."""

# z, half width, front, back [mm], exponent of the superellipse
_PROFILE = np.array(
    [
        [575.0, 50.0, -46.0, 47.0, 2.0],
        [558.0, 50.0, -45.0, 47.0, 2.0],
        [545.0, 58.0, -43.0, 51.0, 2.0],
        [533.0, 86.0, -42.0, 58.0, 2.0],
        [520.0, 120.0, -43.0, 65.0, 2.0],
        [504.0, 146.0, -48.0, 72.0, 2.05],
        [484.0, 159.0, -59.0, 79.0, 2.15],
        [460.0, 160.0, -73.0, 85.0, 2.25],
        [430.0, 152.0, -86.0, 89.0, 2.3],
        [400.0, 141.0, -96.0, 90.0, 2.35],
        [370.0, 131.0, -102.0, 87.0, 2.4],
        [335.0, 122.0, -106.0, 78.0, 2.4],
        [300.0, 116.0, -107.0, 66.0, 2.4],
        [260.0, 112.0, -106.0, 54.0, 2.35],
        [225.0, 112.0, -104.0, 49.0, 2.3],
        [190.0, 119.0, -102.0, 52.0, 2.25],
        [155.0, 132.0, -102.0, 61.0, 2.25],
        [120.0, 145.0, -101.0, 73.0, 2.25],
        [80.0, 154.0, -97.0, 85.0, 2.25],
        [40.0, 160.0, -89.0, 90.0, 2.3],
        [0.0, 163.0, -78.0, 86.0, 2.3],
    ]
)[::-1]
# z, depth [mm], half width [mm] of the furrow over the spine, which becomes the cleft between the buttocks
_GROOVE = np.array(
    [
        [575.0, 1.0, 18.0],
        [520.0, 2.0, 19.0],
        [470.0, 6.0, 21.0],
        [400.0, 8.0, 21.0],
        [300.0, 7.0, 20.0],
        [200.0, 7.0, 19.0],
        [135.0, 5.0, 17.0],
        [85.0, 6.0, 14.0],
        [40.0, 14.0, 13.0],
        [0.0, 18.0, 13.0],
    ]
)[::-1]
# Mounds on both sides: |x|, z of the top, height, half width in x, half width in z above and below the top [mm]
_BEHIND = np.array(
    [
        [78.0, 440.0, 5.0, 34.0, 48.0, 48.0],  # shoulder blades
        [68.0, 45.0, 15.0, 46.0, 50.0, 50.0],  # buttocks
        [40.0, 215.0, 3.0, 20.0, 70.0, 70.0],  # erector muscles of the loin
    ]
)
_IN_FRONT = np.array([[64.0, 380.0, 28.0, 37.0, 54.0, 30.0]])  # breasts


@dataclass(frozen=True)
class Section:
    """Half widths of the skin, or of a surface inside it, at heights z [mm]."""

    half_width: np.ndarray
    """Along x, shape (n,)."""
    front: np.ndarray
    """y of the front, negative, shape (n,)."""
    back: np.ndarray
    """y of the back before groove and mounds, shape (n,)."""
    exponent: np.ndarray
    """Of the superellipse, shape (n,)."""
    groove: np.ndarray
    """Depth of the furrow over the spine, shape (n,)."""
    groove_width: np.ndarray
    """Half width of the furrow, shape (n,)."""


def section_at(z: np.ndarray) -> Section:
    """The section of the skin at heights z [mm], shape (n,)."""
    from scipy.interpolate import PchipInterpolator  # heavy

    profile = PchipInterpolator(_PROFILE[:, 0], _PROFILE[:, 1:])(z)
    groove = PchipInterpolator(_GROOVE[:, 0], _GROOVE[:, 1:])(z)
    return Section(*profile.T, *groove.T)


def trunk_skin() -> Surface:
    """The skin: closed, its own mirror image in x = 0, some 4000 vertices."""
    z = np.linspace(_PROFILE[0, 0], _PROFILE[-1, 0], 2000)
    section = section_at(z)
    outline = np.stack([z, section.half_width, section.back], axis=1)
    rings = 1 + round(arc_length(outline)[-1] / (0.87 * EDGE))
    heights = spaced(outline, rings)[::-1, 0]
    loops = [_half_loop(height) for height in heights]
    top, bottom = _cap(loops[0]), _cap(loops[-1])
    return stack([*top[::-1], *(_thinned(loop) for loop in loops), *bottom])


def _half_loop(z: float) -> np.ndarray:
    """Left half of the section at height z, from behind to the front, finely, shape (n, 3)."""
    section = section_at(np.array([z]))
    a, n = section.half_width[0], section.exponent[0]
    centre = 0.5 * (section.front[0] + section.back[0])
    b = 0.5 * (section.back[0] - section.front[0])
    angle = np.linspace(0.5 * np.pi, -0.5 * np.pi, 721)
    c, s = np.cos(angle), np.sin(angle)
    radius = (np.abs(c / a) ** n + np.abs(s / b) ** n) ** (-1.0 / n)
    x = radius * c
    behind = _mounds(_BEHIND, x, z) - section.groove[0] * np.exp(-((x / section.groove_width[0]) ** 2))
    # along the ray, so that the loop keeps the order of its angles
    radius += np.where(s > 0.0, behind, _mounds(_IN_FRONT, x, z)) * s**2
    points = np.stack([radius * c, centre + radius * s, np.full_like(angle, z)], axis=1)
    points[[0, -1], 0] = 0.0
    return points


def _mounds(mounds: np.ndarray, x: np.ndarray, z: float) -> np.ndarray:
    """How far mounds lift the skin at places x (n,) of the height z [mm], shape (n,)."""
    side, top, height, wide, above, below = mounds.T[:, :, None]
    tall = np.where(z > top, above, below)
    return (height * np.exp(-(((x - side) / wide) ** 2) - ((z - top) / tall) ** 2)).sum(axis=0)


def _thinned(loop: np.ndarray) -> np.ndarray:
    return spaced(loop, 1 + max(2, round(arc_length(loop)[-1] / EDGE)))


def _cap(loop: np.ndarray) -> list[np.ndarray]:
    """Half loops that close the end at a loop, from next to it to the point in the middle."""
    centre = np.array([0.0, 0.5 * (loop[0, 1] + loop[-1, 1]), loop[0, 2]])
    rings = round(np.ptp(loop[:, 1]) / 2.0 / EDGE)
    inner = [_thinned(centre + (loop - centre) * (1.0 - k / rings)) for k in range(1, rings)]
    return [*inner, centre[None]]


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
            low, high = starts[k] + i, starts[k + 1] + j
            faces.append((low, low + 1, high) if step_up <= step_down else (low, high + 1, high))
            i, j = (i + 1, j) if step_up <= step_down else (i, j + 1)
    left = np.array(faces)
    on_plane = vertices[:, 0] == 0.0
    mirror = np.arange(len(vertices))
    mirror[~on_plane] = len(vertices) + np.arange((~on_plane).sum())
    both = np.concatenate([vertices, vertices[~on_plane] * [-1.0, 1.0, 1.0]])
    return Surface(both, np.concatenate([left, mirror[left][:, ::-1]]).astype(np.int32))


def spaced(curve: np.ndarray, count: int) -> np.ndarray:
    """`count` points at equal arc length along a polyline, ends kept, shape (count, 3)."""
    points = points_along(curve, np.linspace(0.0, arc_length(curve)[-1], count))
    points[0], points[-1] = curve[0], curve[-1]
    return points
