"""Horizontal sections of a closed surface."""

from __future__ import annotations

import numpy as np

from .errors import InputError
from .surface import Surface


def section(surface: Surface, height: float) -> list[np.ndarray]:
    """Cut a closed surface by the plane z = height [mm].

    A vertex that lies exactly in the plane counts as above it, so that every triangle is cut in two edges or
    not at all, and the cut of a closed surface is closed loops whatever vertices, edges or triangles lie in
    the plane. Points that coincide are given once.

    Returns closed loops, each (k, 2) xy [mm], k >= 3, the first point not repeated; counterclockwise from
    above around the inside of the surface, so that the loop of a hole turns clockwise. Empty where the plane
    misses the surface.

    Raises InputError when the surface is open, or oriented in more than one way, at the plane.
    """
    vertices, faces = surface.vertices, surface.faces.astype(np.int64)
    above = vertices[:, 2] >= height
    count = above[faces].sum(axis=1)
    cut = faces[(count == 1) | (count == 2)]
    if len(cut) == 0:
        return []
    # turn each triangle so that its lonely corner comes first: the cut joins the two edges at that corner
    up = above[cut]
    lonely = np.where((up.sum(axis=1) == 1)[:, None], up, ~up).argmax(axis=1)
    a, b, c = np.take_along_axis(cut, (lonely[:, None] + np.arange(3)) % 3, axis=1).T
    rising = above[a]
    # the inside is to the left of the direction of travel, the face normal to the right
    leave = np.where(rising, _edge_key(a, b, len(vertices)), _edge_key(a, c, len(vertices)))
    enter = np.where(rising, _edge_key(a, c, len(vertices)), _edge_key(a, b, len(vertices)))
    keys = np.unique(leave)
    if len(keys) < len(leave) or not np.array_equal(keys, np.unique(enter)):
        raise InputError(
            f"section: the surface must be closed and oriented where it is cut, at z = {height:g} mm; "
            "repair the surface"
        )
    following = np.empty(len(keys), dtype=np.int64)
    following[np.searchsorted(keys, leave)] = np.searchsorted(keys, enter)
    low, high = vertices[keys // len(vertices)], vertices[keys % len(vertices)]
    share = (height - low[:, 2]) / (high[:, 2] - low[:, 2])
    points = low[:, :2] + share[:, None] * (high[:, :2] - low[:, :2])
    points[high[:, 2] == height] = high[high[:, 2] == height, :2]  # to the bit, so that repeats are seen
    loops = [_without_repeats(points[loop]) for loop in _cycles(following)]
    return [loop for loop in loops if len(loop) >= 3]


def outer_loop(loops: list[np.ndarray]) -> np.ndarray:
    """The loop with the largest enclosed area: the trunk, where arms or cut planes give loops too.

    Raises InputError when there are no loops.
    """
    if not loops:
        raise InputError("section: the plane misses the surface, there is no loop; choose another height")
    return max(loops, key=lambda loop: abs(enclosed_area(loop)))


def enclosed_area(loop: np.ndarray) -> float:
    """Area inside a closed loop (k, 2) [mm^2], positive if it turns counterclockwise."""
    x, y = (loop - loop.mean(axis=0)).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _edge_key(first: np.ndarray, second: np.ndarray, count: int) -> np.ndarray:
    """One number for an edge, the same from both of its faces."""
    return np.minimum(first, second) * count + np.maximum(first, second)


def _cycles(following: np.ndarray) -> list[np.ndarray]:
    """The cycles of a permutation."""
    left = np.ones(len(following), dtype=bool)
    cycles = []
    for start in range(len(following)):
        if not left[start]:
            continue
        cycle, here = [], start
        while left[here]:
            left[here] = False
            cycle.append(here)
            here = int(following[here])
        cycles.append(np.array(cycle))
    return cycles


def _without_repeats(loop: np.ndarray) -> np.ndarray:
    return loop[(loop != np.roll(loop, 1, axis=0)).any(axis=1)]
