"""A close shirt and shorts for a trunk, and its cut edges closed softly: what pictures show by default.

Cloth is a tube of its own, the same rows and columns on every state of a trunk, so that it can be blended like the
skin. It bridges hollows as cloth does: each horizontal section is the convex hull of the skin there. Where a trunk
moves in many steps, a `Garment` is made once and carried by the skin.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.section import sections, trunk_loop
from warp_trunk.geometry.surface import Surface, area_vectors, bends, neighbour_means, shared_edges
from warp_trunk.spine.spine import Spine, asis_axis, spine_of

COLOURS = {"shorts": (92, 107, 122), "shirt": (158, 181, 199)}
"""Of the parts of a garment."""
COLUMNS, SHORTS, SHIRT = 120, 22, 78
"""Columns around the trunk, rows of the shorts and of the shirt."""
SHORTS_FACES = 2 * COLUMNS * (SHORTS - 1)
"""Of the triangles of the cloth the first so many are the shorts."""
OUT, EDGE = 4.0, 1.5
"""Distance of the cloth from the hull of the skin, and at the neckline [mm]."""
_SECTION_STEP = 4.0
"""Distance of the sections that the cloth is made from [mm]."""
_WHOLE = 0.9
"""The lowest sections whose sizes are less than this part of the next are left out: a cut that is not level meets
only a part of the trunk there."""
_SMOOTH = 2.0
"""Standard deviations of the smoothing upwards and around [sections, columns]."""
_BRIDGE, _CHEST = 13, 50.0
"""Peaks are bridged over so many sections and columns, from this far below T1, wholly from twice as far [mm]."""
_WAISTBAND = 5.0
"""The shorts end this far above the iliac spines [mm]."""
_NECK, _FRONT, _BEHIND = 25.0, 75.0, 30.0
"""Highest place of the neckline above T1, and how much lower it is in front and behind [mm]."""
_STRAP = 0.5
"""At the sides the neckline lies at this part of the way to the edge of the shoulder."""
_OPEN = (74.0, 88.0)
"""With an open back, cloth reaches to this angle from the front, at the waistband and at the neck [degrees]."""
_SHARP, _REACH, _ROUNDS = 40.0, 9.0, 40
"""Convex edges sharper than this [degrees] are cuts; they are rounded over about this length [mm]."""


def soft(before: Surface) -> np.ndarray:
    """Part of each vertex that rounding takes, 1 at the edges of cuts and 0 away from them, shape (vertices,).

    A scan ends in planes through neck, arms and thighs; their rims are the only sharp convex edges of a skin.
    """
    from scipy.spatial import KDTree

    edges, pairs = shared_edges(before.faces)
    sharp = np.flatnonzero(bends(before, pairs) > _SHARP)
    first, second = np.moveaxis(before.vertices[before.faces[pairs[sharp]]].mean(axis=2), 1, 0)
    normal = area_vectors(before.vertices, before.faces)[pairs[sharp, 0]]
    convex = np.einsum("ij,ij->i", normal, second - first) < 0.0
    rim = np.unique(edges[sharp[convex]])
    if not len(rim):
        return np.zeros(len(before.vertices))
    distance = KDTree(before.vertices[rim]).query(before.vertices)[0]
    return np.exp(-((distance / _REACH) ** 2))


def softened(skin: Surface, part: np.ndarray) -> Surface:
    """The skin with the edges of its cuts rounded, for pictures; `part` is `soft` of the skin before surgery."""
    mean, vertices = neighbour_means(skin), skin.vertices
    for _ in range(_ROUNDS):
        vertices = vertices + (0.5 * part)[:, None] * (mean @ vertices - vertices)
    return Surface(vertices, skin.faces)


def cloth_of(skin: Surface, landmarks: Landmarks) -> np.ndarray:
    """Shorts and shirt over a skin [mm], shape (SHORTS + SHIRT, COLUMNS, 3), rows from below, columns from the
    left over the back.

    Args:
        skin: closed [mm], as `softened` leaves it.
        landmarks: those that go with it, of iliac spines and T1 [mm].

    Raises:
        InputError: no ASIS among the landmarks, or an open skin.
    """
    from scipy.ndimage import gaussian_filter, gaussian_filter1d, maximum_filter, maximum_filter1d
    from scipy.spatial import ConvexHull

    across = asis_axis(landmarks)
    axes, spine = np.array([across, [-across[1], across[0]]]), spine_of(landmarks)
    heights = np.arange(skin.vertices[:, 2].min() + 1.0, skin.vertices[:, 2].max() - 1.0, _SECTION_STEP)
    order = np.argsort(spine.centroids[:, 2])
    line = [np.interp(heights, spine.centroids[order, 2], spine.centroids[order, k]) for k in (0, 1)]
    hulls = []
    for height, at, loops in zip(heights, np.transpose(line), sections(skin, heights.tolist()), strict=True):
        above = trunk_loop(loops, at) if height > spine.centroids[:, 2].min() else None  # arms hang beside
        points = np.concatenate([above] if above is not None else loops or [at[None]]) @ axes.T
        hulls.append(points[ConvexHull(points).vertices] if len(points) > 2 else None)
    hulled = [number for number, hull in enumerate(hulls) if hull is not None]
    heights, hulls = heights[hulled], [hulls[number] for number in hulled]
    boxes = np.array([[hull.min(axis=0), hull.max(axis=0)] for hull in hulls])
    size = boxes[:, 1] - boxes[:, 0]
    whole = int(np.argmax((size[:-1] > _WHOLE * size[1:]).all(axis=1)))
    heights, hulls = heights[whole:], hulls[whole:]
    middle = gaussian_filter1d(boxes[whole:].mean(axis=1), 5.0, axis=0, mode="nearest")
    turn = np.radians(np.arange(COLUMNS) * 360.0 / COLUMNS)
    ways = np.column_stack([np.cos(turn), np.sin(turn)])
    hull_at = np.array([_reach(hull - at, ways) for hull, at in zip(hulls, middle, strict=True)])
    even = gaussian_filter1d(gaussian_filter1d(hull_at, _SMOOTH, 0, mode="nearest"), _SMOOTH, 1, mode="wrap")
    least = maximum_filter1d(hull_at, 3, axis=0, mode="nearest")  # shoulders slope: out is also up there
    below = np.clip((spine.centroids[:, 2].max() - _CHEST - heights) / _CHEST, 0.0, 1.0)[:, None]
    peaks = np.maximum(least - even - (OUT - EDGE), 0.0) * below  # what would show through
    ends: Any = ("nearest", "wrap")  # one for each axis
    even += gaussian_filter(maximum_filter(peaks, _BRIDGE, mode=ends), _BRIDGE / 4.0, mode=ends)
    bottom = skin.vertices[:, 2].min() - 1.0
    waist = 0.5 * (landmarks.point("asis_left") + landmarks.point("asis_right"))[2]
    waist = np.clip(waist + _WAISTBAND, bottom + 1.0, heights[-1] - 2.0)
    top = gaussian_filter1d(np.maximum(_neckline(hull_at, heights, turn, spine), waist + 1.0), 3.0, mode="wrap")
    low = np.broadcast_to(np.linspace(bottom, waist, SHORTS)[:, None], (SHORTS, COLUMNS))
    high = waist + np.linspace(0.0, 1.0, SHIRT)[:, None] * (top - waist)
    z = np.concatenate([low, high])
    to_neck = np.clip((top - z) / 12.0, 0.0, 1.0)  # close at the neckline
    radius = np.empty_like(z)
    for column in range(COLUMNS):
        near, far = (np.interp(z[:, column], heights, field[:, column]) for field in (least, even))
        out = EDGE + (OUT - EDGE) * to_neck[:, column]
        radius[:, column] = np.maximum(far + out, near + EDGE)
    centre = np.stack([np.interp(z, heights, middle[:, k]) for k in (0, 1)], axis=-1)
    return np.concatenate([(centre + radius[:, :, None] * ways) @ axes, z[:, :, None]], axis=2)


def _reach(hull: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """How far a convex polygon (points, 2), counterclockwise about 0, reaches in each direction (n, 2)."""
    along = np.roll(hull, -1, axis=0) - hull
    out = np.column_stack([along[:, 1], -along[:, 0]])
    ahead = ways @ out.T
    far = np.maximum((hull * out).sum(axis=1), 0.0)
    return np.min(np.divide(far, ahead, out=np.full_like(ahead, np.inf), where=ahead > 1e-9), axis=1)


def _neckline(reach: np.ndarray, heights: np.ndarray, turn: np.ndarray, spine: Spine) -> np.ndarray:
    """Height of the neckline in each column [mm]: a boat neck, lower in front than behind."""
    neck = spine.centroids[spine.levels.index("T1"), 2] if "T1" in spine.levels else spine.centroids[:, 2].max()
    beside, behind = np.cos(turn), np.sin(turn)
    clamp = neck + _NECK - _FRONT * np.maximum(-behind, 0.0) ** 2 - _BEHIND * np.maximum(behind, 0.0) ** 2
    wide = reach[np.argmin(np.abs(heights - (neck - 30.0)))]
    # few vertices may leave the middle outside
    half = max(_STRAP * 0.5 * (wide[0] + wide[len(wide) // 2]), _SECTION_STEP)
    ring = 1.0 / np.sqrt((beside / half) ** 2 + (behind / (0.5 * half)) ** 2)
    inside = (reach >= ring) & (heights[:, None] <= clamp)
    return heights[len(heights) - 1 - np.argmax(inside[::-1], axis=0)]


def cloth_faces() -> np.ndarray:
    """Triangles of the cloth, outward, shape (n, 3)."""
    return _grid(SHORTS + SHIRT, COLUMNS, closed=True)


def _grid(rows: int, columns: int, *, closed: bool) -> np.ndarray:
    """Triangles between points, row by row, shape (n, 3); `closed` joins the last column to the first."""
    number = np.arange(rows * columns).reshape(rows, columns)
    if closed:
        number = np.column_stack([number, number[:, :1]])
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    faces = np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)], axis=2)
    return faces.reshape(-1, 3).astype(np.int32)


def cloth_surfaces(cloth: np.ndarray, *, shirt: bool) -> tuple[Surface, Surface]:
    """Shorts and shirt as surfaces with the same vertices; without triangles the one that is not worn."""
    faces, places = cloth_faces(), cloth.reshape(-1, 3)
    return Surface(places, faces[:SHORTS_FACES]), Surface(places, faces[SHORTS_FACES:] if shirt else faces[:0])


def _edge(up: np.ndarray) -> np.ndarray:
    """Angle from the front to which a shirt that is open behind reaches [degrees], from waistband 0 to neck 1."""
    return _OPEN[0] + (_OPEN[1] - _OPEN[0]) * up**1.5


def open_back() -> np.ndarray:
    """How far inside the edge of a shirt that is open behind each place of the cloth lies [degrees about the
    trunk], positive inside; shape (SHORTS + SHIRT, COLUMNS)."""
    from_front = np.abs((np.arange(COLUMNS) * 360.0 / COLUMNS - 270.0 + 180.0) % 360.0 - 180.0)
    shirt = _edge(np.linspace(0.0, 1.0, SHIRT))[:, None] - from_front
    return np.concatenate([np.full((SHORTS, COLUMNS), 90.0), shirt])


_OPEN_COLUMNS = 61
"""Columns of a shirt that is open behind, from edge to edge."""
_CARRIERS = 8
"""Vertices of the skin that carry a point of a garment."""


def open_shirt(cloth: np.ndarray) -> np.ndarray:
    """The shirt of a cloth up to the edges at which it is open behind, shape (SHIRT, columns, 3).

    Its columns go from the edge at the right side over the front to the left one.
    """
    columns = np.arange(COLUMNS + 1)
    shirt = np.concatenate([cloth[SHORTS:], cloth[SHORTS:, :1]], axis=1)
    half = _edge(np.linspace(0.0, 1.0, SHIRT))[:, None]
    at = ((270.0 + half * np.linspace(-1.0, 1.0, _OPEN_COLUMNS)) % 360.0) * COLUMNS / 360.0
    return np.stack(
        [
            [np.interp(row_at, columns, row[:, axis]) for row_at, row in zip(at, shirt, strict=True)]
            for axis in range(3)
        ],
        axis=-1,
    )


class Garment:
    """Shorts and a shirt that is open behind, carried by the skin of a trunk that moves."""

    def __init__(self, skin: Surface, landmarks: Landmarks) -> None:
        """Fits them to a skin with its landmarks, as `cloth_of`, which says what it raises."""
        from scipy.sparse import csr_array
        from scipy.spatial import KDTree

        cloth = cloth_of(skin, landmarks)
        rows = {"shorts": (cloth[:SHORTS], True), "shirt": (open_shirt(cloth), False)}
        self.faces = {name: _grid(*grid.shape[:2], closed=closed) for name, (grid, closed) in rows.items()}
        """Triangles of `shorts` and `shirt`, outward, shape (n, 3)."""
        self._parts, self._skin, tree = {}, skin.vertices, KDTree(skin.vertices)
        for name, (grid, _) in rows.items():
            places = grid.reshape(-1, 3)
            distance, near = tree.query(places, k=_CARRIERS)
            weight = 1.0 / (distance + 1e-6)
            weight /= weight.sum(axis=1, keepdims=True)
            ends = np.arange(0, near.size + 1, _CARRIERS)
            carriers = csr_array((weight.ravel(), near.ravel(), ends), shape=(len(places), len(skin.vertices)))
            self._parts[name] = places, carriers

    def on(self, vertices: np.ndarray) -> dict[str, np.ndarray]:
        """Vertices of `shorts` and `shirt` where the skin has moved to `vertices`, (vertices, 3); all [mm]."""
        way = vertices - self._skin
        return {name: places + carriers @ way for name, (places, carriers) in self._parts.items()}
