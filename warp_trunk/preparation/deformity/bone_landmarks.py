"""Landmarks found on bone meshes alone: six on each vertebra, and the two anterior superior iliac spines."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from warp_trunk.case.landmarks import VERTEBRA_POINTS, Landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface

VERTEBRAE = (*(f"T{i}" for i in range(1, 13)), *(f"L{i}" for i in range(1, 6)))
"""Thoracic and lumbar vertebrae from the top down."""
_BEHIND = (0.5, 8.0)
"""Where the narrowest section of a pedicle is looked for: behind the body's back wall [mm]."""


def find_landmarks(bones: Mapping[str, Surface]) -> Landmarks:
    """Landmarks of an upright, straight spine in patient axes (LPS), each on the surface of its bone.

    Endplate centres lie in the vertebra's median plane, pedicle points at the top and the bottom of the
    pedicle's narrowest section, and the iliac spines are the front of the upper half of each hip bone.

    Args:
        bones: surfaces by name; `T1` to `L5`, as many as there are, `hip_left` and `hip_right`. Others are
            not looked at.

    Raises:
        InputError: no vertebra, a missing hip bone, or a mesh in which the points are not to be found.
    """
    present = [name for name in VERTEBRAE if name in bones]
    missing = [name for name in ("hip_left", "hip_right") if name not in bones]
    if missing or not present:
        what = f"'{missing[0]}'" if missing else "any of T1 to L5"
        raise InputError(f"bones: {what} is missing; landmarks need the vertebrae and both hip bones")
    names: list[str] = []
    points: list[np.ndarray] = []
    for bone in present:
        names += [f"{bone}_{point}" for point in VERTEBRA_POINTS]
        points += _vertebra(bone, bones[bone])
    for side in ("left", "right"):
        names.append(f"asis_{side}")
        points.append(_iliac_spine(bones[f"hip_{side}"]))
    return Landmarks(names=tuple(names), points=np.array(points))


def _vertebra(name: str, surface: Surface) -> list[np.ndarray]:
    middle = float(surface.vertices[:, 0].min() + surface.vertices[:, 0].max()) / 2

    # the canal parts the median section into the body, in front, and the spinous process
    body = min(_cut(surface, np.array([1.0, 0.0, 0.0]), middle), key=lambda part: part[..., 1].mean())
    outline = body.reshape(-1, 3)[:, 1:]
    centre, forward, up = _upright_box(outline)
    found = [np.array([middle, *_along(outline, centre, sign * up)]) for sign in (1.0, -1.0)]

    for side, word in ((1.0, "left"), (-1.0, "right")):
        pedicle = _pedicle(surface, middle, outline, forward, up, side)
        if pedicle is None:
            raise InputError(
                f"bones: '{name}' shows no {word} pedicle behind its body; "
                "it must be one closed vertebra with its arch, upright, in axes +x left, +y back, +z up"
            )
        height = pedicle[:, 1:] @ up
        found += [pedicle[height.argmax()], pedicle[height.argmin()]]
    return found


def _pedicle(
    surface: Surface, middle: float, body: np.ndarray, forward: np.ndarray, up: np.ndarray, side: float
) -> np.ndarray | None:
    """Section of a pedicle, shape (points, 3), by the plane across the body's axis where it is smallest."""
    backward = np.array([0.0, *-forward])
    heights = body @ up
    top, centre = heights.max(), (heights.min() + heights.max()) / 2
    best, smallest = None, np.inf
    for depth in (body @ -forward).max() + np.arange(_BEHIND[0], _BEHIND[1], 0.5):
        for part in _cut(surface, backward, float(depth)):
            points = part.reshape(-1, 3)
            height = points[:, 1:] @ up
            aside = (side * (points[:, 0] - middle)).min() > 0.0  # not the arch, nor the body
            level = height.min() < top and height.max() > max(centre, top - 8.0)  # no process further down
            size = np.ptp(points[:, 0]) * np.ptp(height)
            if aside and level and size < smallest:
                best, smallest = points, size
    return best


def _iliac_spine(hip: Surface) -> np.ndarray:
    # the pubis reaches as far forward, but lies in the lower half
    z = hip.vertices[:, 2]
    upper = hip.vertices[z > (z.min() + z.max()) / 2]
    return upper[upper[:, 1].argmin()]


def _upright_box(outline: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centre, forward and up axes of the smallest rectangle around points (n, 2) of a (y, z) plane."""
    tilts = np.radians(np.arange(-45.0, 45.0, 0.5))
    forward = np.column_stack([-np.cos(tilts), np.sin(tilts)])
    up = np.column_stack([np.sin(tilts), np.cos(tilts)])
    a, b = outline @ forward.T, outline @ up.T
    best = int((np.ptp(a, axis=0) * np.ptp(b, axis=0)).argmin())
    f, u = forward[best], up[best]
    half = [(s[:, best].min() + s[:, best].max()) / 2 for s in (a, b)]
    return half[0] * f + half[1] * u, f, u


def _along(outline: np.ndarray, centre: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Where the ray from the centre leaves an outline given as segments, shape (2 segments, 2) -> (2,)."""
    a, b = outline[0::2] - centre, outline[1::2] - centre
    across = np.array([-direction[1], direction[0]])
    sa, sb = a @ across, b @ across
    crossed = sa * sb <= 0.0
    crossed &= np.abs(sa - sb) > 0.0
    t = (sa[crossed] / (sa[crossed] - sb[crossed]))[:, None]
    hits = a[crossed] + t * (b[crossed] - a[crossed])
    return centre + hits[(hits @ direction).argmax()]


def _cut(surface: Surface, normal: np.ndarray, offset: float) -> list[np.ndarray]:
    """Section by the plane normal . x = offset: the segments of each of its closed parts, shape (k, 2, 3)."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    side = surface.vertices @ normal - offset
    side[side == 0.0] = 1e-9  # a vertex on the plane would leave a part open
    above = side > 0.0
    faces = surface.faces[above[surface.faces].any(axis=1) & ~above[surface.faces].all(axis=1)]
    if len(faces) == 0:
        return []
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2)  # (faces, 3, 2)
    crossing = above[edges].sum(axis=2) == 1
    edges = np.sort(edges[crossing], axis=1)  # two for each face, in its order
    ends, number = np.unique(edges, axis=0, return_inverse=True)
    d0, d1 = side[ends[:, 0]], side[ends[:, 1]]
    p0, p1 = surface.vertices[ends[:, 0]], surface.vertices[ends[:, 1]]
    points = p0 + (d0 / (d0 - d1))[:, None] * (p1 - p0)
    segments = number.reshape(-1, 2)
    graph = coo_matrix((np.ones(len(segments)), segments.T), shape=(len(points), len(points)))
    count, part = connected_components(graph, directed=False)
    return [points[segments[part[segments[:, 0]] == i]] for i in range(count)]
