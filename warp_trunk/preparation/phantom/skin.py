"""The skin of the phantom: superelliptic sections from neck to hips, with shoulders, waist and spinal groove.

All lengths are at the reference size, 480 x 300 x 190 mm or close to it; `phantom.py` scales.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warp_trunk.geometry.surface import Surface

from .shapes import spaced, stack

EDGE = 11.5
"""Wanted edge length of the skin [mm]."""

# z, half width, front, back [mm], exponent of the superellipse
_PROFILE = np.array(
    [
        [480.0, 50.0, -50.0, 42.0, 2.0],
        [462.0, 49.0, -51.0, 43.0, 2.0],
        [446.0, 53.0, -53.0, 46.0, 2.0],
        [432.0, 71.0, -55.0, 51.0, 2.0],
        [418.0, 100.0, -58.0, 57.0, 2.0],
        [404.0, 126.0, -62.0, 64.0, 2.05],
        [388.0, 142.0, -68.0, 71.0, 2.1],
        [366.0, 149.0, -76.0, 80.0, 2.2],
        [335.0, 148.0, -86.0, 88.0, 2.3],
        [300.0, 141.0, -94.0, 91.0, 2.4],
        [260.0, 132.0, -95.0, 88.0, 2.4],
        [220.0, 122.0, -90.0, 79.0, 2.4],
        [185.0, 117.0, -84.0, 70.0, 2.4],
        [150.0, 119.0, -82.0, 67.0, 2.4],
        [115.0, 130.0, -83.0, 72.0, 2.4],
        [80.0, 143.0, -84.0, 83.0, 2.4],
        [45.0, 150.0, -82.0, 91.0, 2.4],
        [0.0, 147.0, -74.0, 86.0, 2.4],
    ]
)[::-1]
# z, depth [mm], half width [mm] of the furrow over the spine, which becomes the cleft between the buttocks
_GROOVE = np.array(
    [
        [480.0, 1.0, 16.0],
        [430.0, 2.0, 16.0],
        [380.0, 6.0, 17.0],
        [300.0, 8.0, 17.0],
        [220.0, 9.0, 17.0],
        [160.0, 9.0, 17.0],
        [110.0, 6.0, 16.0],
        [70.0, 5.0, 13.0],
        [30.0, 13.0, 12.0],
        [0.0, 16.0, 12.0],
    ]
)[::-1]
# Mounds on both sides of the back: |x|, z of the top, height, half width in x, half width in z [mm].
_MOUNDS = np.array(
    [
        [72.0, 335.0, 6.0, 30.0, 42.0],  # shoulder blades
        [62.0, 38.0, 9.0, 40.0, 34.0],  # buttocks
        [38.0, 170.0, 2.5, 18.0, 60.0],  # erector muscles of the loin
    ]
)


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
    rings = 1 + round(np.linalg.norm(np.diff(outline, axis=0), axis=1).sum() / (0.87 * EDGE))
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
    x, behind = radius * c, s > 0.0
    lift = -section.groove[0] * np.exp(-((x / section.groove_width[0]) ** 2))
    for x0, z0, height, wide, tall in _MOUNDS:
        lift += height * np.exp(-(((x - x0) / wide) ** 2) - ((z - z0) / tall) ** 2)
    radius += lift * behind * np.abs(s) ** 2  # along the ray, so that the loop keeps the order of its angles
    points = np.stack([radius * c, centre + radius * s, np.full_like(angle, z)], axis=1)
    points[[0, -1], 0] = 0.0
    return points


def _thinned(loop: np.ndarray, least: int = 2) -> np.ndarray:
    length = np.linalg.norm(np.diff(loop, axis=0), axis=1).sum()
    return spaced(loop, 1 + max(least, round(length / EDGE)))


def _cap(loop: np.ndarray) -> list[np.ndarray]:
    """Half loops that close the end at a loop, from next to it to the point in the middle."""
    centre = np.array([0.0, 0.5 * (loop[0, 1] + loop[-1, 1]), loop[0, 2]])
    rings = round(np.ptp(loop[:, 1]) / 2.0 / EDGE)
    inner = [_thinned(centre + (loop - centre) * (1.0 - k / rings)) for k in range(1, rings)]
    return [*inner, centre[None]]
