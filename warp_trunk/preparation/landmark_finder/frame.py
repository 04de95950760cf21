"""A bone in axes of its own, and its sections there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warp_trunk.geometry.section import enclosed_area, section
from warp_trunk.geometry.surface import Surface

_SPECK = 10.0
"""A part of a section smaller than this is no part of a bone [mm2]."""
_STEP = 0.5
"""Distance of points along an outline [mm]."""


@dataclass(frozen=True, eq=False)
class Frame:
    """Axes of a bone: local = axes (x - centre), to its left, its back and up."""

    axes: np.ndarray
    """Orthonormal rows, right-handed, shape (3, 3)."""
    centre: np.ndarray
    """Origin [mm], shape (3,)."""

    def inside(self, surface: Surface) -> Surface:
        """The surface in these axes."""
        return Surface((surface.vertices - self.centre) @ self.axes.T, surface.faces)

    def outside(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 3) of these axes in those of the patient."""
        return points @ self.axes + self.centre

    def pitched(self, angle: float) -> Frame:
        """These axes turned about the first, `up` towards `back` by an angle [rad]."""
        c, s = np.cos(angle), np.sin(angle)
        return Frame(np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]) @ self.axes, self.centre)


def sagittal(surface: Surface, left: float) -> list[np.ndarray]:
    """Loops of the section where the first coordinate is `left`, each (k, 2) of back and up [mm]."""
    return _parts(surface, [1, 2, 0], left)


def coronal(surface: Surface, back: float) -> list[np.ndarray]:
    """Loops of the section where the second coordinate is `back`, each (k, 2) of left and up [mm]."""
    return [loop[::-1, ::-1] for loop in _parts(surface, [2, 0, 1], back)]


def outline(loop: np.ndarray) -> np.ndarray:
    """Points at equal steps along a loop (k, 2), so that short edges count no more than long ones."""
    length = np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1)
    reached = np.concatenate([[0.0], np.cumsum(length)])
    ring = np.vstack([loop, loop[:1]])
    places = np.arange(0.0, reached[-1], _STEP)
    return np.stack([np.interp(places, reached, column) for column in ring.T], axis=1)


def centroid(loop: np.ndarray) -> np.ndarray:
    """Of the area inside a loop (k, 2), shape (2,)."""
    middle = loop.mean(axis=0)
    one = loop - middle
    two = np.roll(one, -1, axis=0)
    weight = one[:, 0] * two[:, 1] - two[:, 0] * one[:, 1]
    return middle + (one + two).T @ weight / (3.0 * weight.sum())


def last_crossing(loop: np.ndarray, start: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Where a ray from within a loop (k, 2) leaves it for good, shape (2,)."""
    a, b = loop - start, np.roll(loop, -1, axis=0) - start
    across = np.array([-direction[1], direction[0]])
    side_a, side_b = a @ across, b @ across
    crossed = (side_a < 0.0) != (side_b < 0.0)
    share = side_a[crossed] / (side_a[crossed] - side_b[crossed])
    hits = a[crossed] + share[:, None] * (b - a)[crossed]
    return start + hits[(hits @ direction).argmax()]


def _parts(surface: Surface, order: list[int], offset: float) -> list[np.ndarray]:
    turned = Surface(surface.vertices[:, order], surface.faces)  # an even permutation: winding stays
    return [loop for loop in section(turned, offset) if abs(enclosed_area(loop)) > _SPECK]
