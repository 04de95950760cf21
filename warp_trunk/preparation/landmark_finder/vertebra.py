"""The six landmarks of one vertebra, whichever way it is turned, by its symmetry and its sections."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.section import arc_length, enclosed_area, last_crossing, points_along, section
from warp_trunk.geometry.surface import Surface, area_vectors, unit


class UnsureError(Exception):
    """The reason why a landmark was not found on a bone, in words that follow the bone's name and a colon."""


@dataclass(frozen=True, eq=False)
class FoundVertebra:
    """The six landmarks of a vertebra, its axes, and what speaks for them."""

    points: np.ndarray
    """In the order of `VERTEBRA_POINTS` [mm], shape (6, 3)."""
    axes: np.ndarray
    """Unit vectors to the vertebra's left, back and up, one in each row, shape (3, 3)."""
    asymmetry: float
    """Median distance of the vertebra from its mirror image in the plane of left and right [mm]."""
    off_curve: float
    """Angle between the vertebra's axis and the curve through the centres of its neighbours [deg]."""

    @property
    def height(self) -> float:
        """Between the two endplate centres [mm]."""
        return float(np.linalg.norm(self.points[0] - self.points[1]))


_SAMPLES, _COARSE, _FINE = 3000, 200, 1000
"""Points on the bone: those that are looked up, and those that are mirrored in the search and in the fit."""
_NORMAL_WEIGHT = 5.0
"""Normals that are opposite count as far apart as points at twice this distance [mm]: the two walls of a thin
lamina are not taken for each other."""
_SMOOTHED = 8
"""Normals are averaged over this many points, so that the steps of voxels do not count."""
_OUTLIER = 1.0
"""Distances beyond this count less and less [mm]: a bent spinous process does not turn the plane."""
_CAP = 5.0
"""Distances count no further than this in the search [mm]."""
_TURNS = np.arange(-60.0, 61.0, 15.0)
"""Where the plane is looked for: turned about the bone's axis ..."""
_LEANS = np.array([-15.0, 0.0, 15.0])
"""... and leaning sideways [deg]."""
_STARTS = 3
"""As many of the best of these are followed."""


def symmetry_plane(surface: Surface, left: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, float, float]:
    """The plane nearest to `left` in which the bone differs least from its mirror image.

    A coarse search over directions, then least squares of the distances of mirrored points along the normals
    where they arrive, with a loss that hardly sees outliers. Points are spread evenly over the area, so that
    how the bone is meshed does not matter.

    Args:
        surface: a bone.
        left: unit vector within 60 degrees of the bone's left seen along `up`, shape (3,).
        up: unit vector along the bone, shape (3,).

    Returns:
        Of the plane normal . x = offset the normal, a unit vector to the left, shape (3,), and the offset [mm];
        and the median distance of the mirrored bone from itself [mm].
    """
    points, normals = spread_points(surface, _SAMPLES)
    middle = points.mean(axis=0)
    left = unit(left - (left @ up) * up)
    axes = np.stack([left, np.cross(up, left), up])
    distances = _mirror_distances((points - middle) @ axes.T, normals @ axes.T)
    grid = [np.array([*np.radians([turn, lean]), 0.0]) for turn in _TURNS for lean in _LEANS]
    grid.sort(key=lambda plane: np.minimum(np.abs(distances(plane, _COARSE)), _CAP).mean())
    fits = [_fitted(distances, plane, _COARSE) for plane in grid[:_STARTS]]
    start = min(fits, key=lambda plane: np.minimum(np.abs(distances(plane, _FINE)), _CAP).mean())
    best = _fitted(distances, start, _FINE)
    normal = _direction(best) @ axes
    return normal, float(normal @ middle + best[2]), float(np.median(np.abs(distances(best, _SAMPLES))))


_Distances = Callable[[np.ndarray, int], np.ndarray]


def _mirror_distances(points: np.ndarray, normals: np.ndarray) -> _Distances:
    """Distances of mirrored points from the surface, of a plane (two angles [rad], offset [mm]) and a count."""
    from scipy.spatial import KDTree  # heavy

    places = np.hstack([points, _NORMAL_WEIGHT * normals])
    normals = normals[KDTree(places).query(places, k=_SMOOTHED)[1]].mean(axis=1)
    normals = unit(normals)
    tree = KDTree(np.hstack([points, _NORMAL_WEIGHT * normals]))

    def distances(plane: np.ndarray, count: int) -> np.ndarray:
        n = _direction(plane)
        mirrored = points[:count] - 2.0 * (points[:count] @ n - plane[2])[:, None] * n
        facing = normals[:count] - 2.0 * (normals[:count] @ n)[:, None] * n
        nearest = tree.query(np.hstack([mirrored, _NORMAL_WEIGHT * facing]))[1]
        return np.einsum("ij,ij->i", mirrored - points[nearest], normals[nearest])

    return distances


def _fitted(distances: _Distances, start: np.ndarray, count: int) -> np.ndarray:
    from scipy.optimize import least_squares  # heavy

    return least_squares(
        distances, start, args=(count,), loss="soft_l1", f_scale=_OUTLIER, x_scale=[0.05, 0.05, 1.0],
        diff_step=1e-3, xtol=1e-5, ftol=1e-6,
    ).x  # fmt: skip


def spread_points(surface: Surface, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points spread evenly over a surface's area and the unit normals there, each (count, 3), always the same."""
    a, b, c = np.moveaxis(surface.vertices[surface.faces], 1, 0)
    vectors = area_vectors(surface.vertices, surface.faces)
    area = np.linalg.norm(vectors, axis=1)
    rng = np.random.default_rng(0)
    # one point in each of `count` equal shares of the area, in an order that has nothing to do with place
    shares = rng.permutation(count) + rng.random(count)
    face = np.searchsorted(np.cumsum(area), shares * area.sum() / count).clip(max=len(area) - 1)
    u, v = rng.random((2, count))
    over = u + v > 1.0
    u, v = np.where(over, 1.0 - u, u)[:, None], np.where(over, 1.0 - v, v)[:, None]
    points = a[face] + u * (b - a)[face] + v * (c - a)[face]
    return points, unit(vectors[face])


def _direction(plane: np.ndarray) -> np.ndarray:
    """Unit vector near the first axis, turned about the third and lifted towards it by two angles [rad]."""
    turn, lean = plane[:2]
    return np.array([np.cos(lean) * np.cos(turn), np.cos(lean) * np.sin(turn), np.sin(lean)])


_SPECK = 10.0
"""A part of a section smaller than this is no part of a bone [mm2]."""
_OUTLINE_STEP = 0.5
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
    turned = Surface(surface.vertices[:, [1, 2, 0]], surface.faces)  # an even permutation: winding stays
    return [loop for loop in section(turned, left) if abs(enclosed_area(loop)) > _SPECK]


def coronal(surface: Surface, back: float) -> list[np.ndarray]:
    """Loops of the section where the second coordinate is `back`, each (k, 2) of left and up [mm]."""
    turned = Surface(surface.vertices[:, [2, 0, 1]], surface.faces)
    return [loop[::-1, ::-1] for loop in section(turned, back) if abs(enclosed_area(loop)) > _SPECK]


def outline(loop: np.ndarray) -> np.ndarray:
    """Points at equal steps along a loop (k, 2), so that short edges count no more than long ones."""
    ring = np.vstack([loop, loop[:1]])
    return points_along(ring, np.arange(0.0, arc_length(ring)[-1], _OUTLINE_STEP))


def centroid(loop: np.ndarray) -> np.ndarray:
    """Of the area inside a loop (k, 2), shape (2,)."""
    middle = loop.mean(axis=0)
    corner = loop - middle
    next_corner = np.roll(corner, -1, axis=0)
    weight = corner[:, 0] * next_corner[:, 1] - next_corner[:, 0] * corner[:, 1]
    return middle + (corner + next_corner).T @ weight / (3.0 * weight.sum())


def leaving(loop: np.ndarray, start: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Where a ray from within a loop (k, 2) leaves it for good, shape (2,)."""
    crossing = last_crossing(np.stack([loop, np.roll(loop, -1, axis=0)], axis=1), start, direction)
    assert crossing is not None
    return crossing


_MOST_ASYMMETRY = 2.5
"""Of a vertebra whose left and right can be distinguished [mm]."""
_MOST_OFF_CURVE = 40.0
"""Of a vertebra whose top can be determined [deg]: a lordotic L5 leans by 25 against the line to L4."""
_PITCHES = np.radians(np.arange(-35.0, 36.0, 1.0))
_BESIDE = 0.12
"""Sections beside the median one, at this and twice this part of the body's depth: still inside the body."""
_BEHIND = 0.35
"""Pedicles are looked for as far behind the body as this part of its depth."""
_RISE = 1.1
"""Where the section of a pedicle has grown by this, the narrowest place is passed."""
_FLAT = 1.02
"""Sections larger by no more than this are as narrow as the narrowest; of them the middle one is taken."""
_WIDEST = 1.3
"""Width of a pedicle over its height; what lies further from the canal belongs to the transverse process."""
_UNEVEN = 0.5
"""The smaller of two opposite pedicles over the larger, in its distance from the median plane and its height: less
and one of them is a ridge of the body's wall or a part of the arch."""
_NEIGHBOURS_BODY = 0.3
"""A second part in front of the canal with this share of the body's area is another body."""


def find_vertebra(surface: Surface, left: np.ndarray, up: np.ndarray) -> FoundVertebra:
    """The landmarks of a vertebra of which only the rough directions are known.

    The plane in which the vertebra is most nearly its own mirror image is its median plane; its section is
    parted by the canal into the body and the spinous process. The vertebra's axis is across its endplates there
    and beside. Endplate centres are where the axis leaves the body's outline. Pedicle points are where the
    direction of the axis leaves the narrowest section of each pedicle, through its centroid; both sections lie
    in one plane across the vertebra, so that rotation is that of the whole bone and not of two small points.

    Args:
        surface: one vertebra.
        left: unit vector within 60 degrees of the vertebra's left, shape (3,).
        up: unit vector within 30 degrees of its axis, shape (3,).

    Raises:
        UnsureError: a landmark could not be determined.
    """
    normal, offset, asymmetry = symmetry_plane(surface, left, up)
    if asymmetry > _MOST_ASYMMETRY:
        sides = f"its left and right differ by {asymmetry:.1f} mm (median), {_MOST_ASYMMETRY:g} is the most"
        raise UnsureError(f"{sides}; is it whole, alone and in one piece?")
    upright = unit(up - (up @ normal) * normal)
    middle = surface.vertices.mean(axis=0)
    middle += (offset - normal @ middle) * normal
    frame = Frame(np.stack([normal, np.cross(upright, normal), upright]), middle)
    try:
        frame = frame.pitched(_pitch(frame.inside(surface)))
        points = frame.outside(_six(frame.inside(surface)))
    except InputError as fault:  # a section that does not close
        raise UnsureError(str(fault)) from None
    off_curve = float(np.degrees(np.arccos(min(1.0, frame.axes[2] @ up))))
    if off_curve > _MOST_OFF_CURVE:
        raise UnsureError(f"its endplates are {off_curve:.0f} degrees off the curve of the spine")
    return FoundVertebra(points, frame.axes, asymmetry, off_curve)


def _body(local: Surface, left: float = 0.0) -> np.ndarray:
    """Outline of the body, (k, 2) of back and up, in a sagittal section."""
    parts = sagittal(local, left)
    if not parts:
        raise UnsureError("its median plane misses it")
    return min(parts, key=lambda part: part[:, 0].mean())


def _pitch(local: Surface) -> float:
    """How far the axis across the endplates leans to the back from the third axis [rad]."""
    body = _body(local)
    behind = [part for part in sagittal(local, 0.0) if part is not body and part[:, 0].min() > body[:, 0].mean()]
    if len(behind) == 0:
        raise UnsureError("no canal between its body and its spinous process in the median section")
    points = outline(body)
    back = np.column_stack([np.cos(_PITCHES), -np.sin(_PITCHES)])
    up = np.column_stack([np.sin(_PITCHES), np.cos(_PITCHES)])
    boxes = np.ptp(points @ back.T, axis=0) * np.ptp(points @ up.T, axis=0)
    pitch = _across_endplates(points, float(_PITCHES[boxes.argmin()]))
    depth, wall = float(np.ptp(points[:, 0])), points[:, 0].max()
    pitches = [pitch]
    for left in _BESIDE * depth * np.array([-2.0, -1.0, 1.0, 2.0]):
        beside = outline(_body(local, float(left)))
        pitches.append(_across_endplates(beside[beside[:, 0] < wall], pitch))  # not the pedicles behind it
    return float(np.median(pitches))


def _across_endplates(points: np.ndarray, pitch: float) -> float:
    """The mean direction across lines through the upper and the lower endplate in least squares [rad].

    points: of the outline of a body, back and up, shape (n, 2); pitch: where to start [rad].
    """
    for _ in range(10):
        back, up = points @ [np.cos(pitch), -np.sin(pitch)], points @ [np.sin(pitch), np.cos(pitch)]
        low, high = back.min(), back.max()
        inner = (back > low + 0.15 * (high - low)) & (back < high - 0.15 * (high - low))
        middle = (up.min() + up.max()) / 2.0
        plates = [inner & (up > middle), inner & (up < middle)]
        if min(plate.sum() for plate in plates) < 3:
            raise UnsureError("its body shows no two endplates in the median section")
        step = np.arctan(np.mean([np.polyfit(back[plate], up[plate], 1)[0] for plate in plates]))
        pitch -= step
        if abs(step) < 1e-5:
            break
    return pitch


def _six(local: Surface) -> np.ndarray:
    """Landmarks (6, 3) of an upright vertebra."""
    body = _body(local)
    for part in sagittal(local, 0.0):
        before_canal = (part[:, 0].mean() - body[:, 0].mean()) < 0.5 * np.ptp(body[:, 0])
        apart = abs(part[:, 1].mean() - body[:, 1].mean()) > 1.0
        if before_canal and apart and abs(enclosed_area(part)) > _NEIGHBOURS_BODY * abs(enclosed_area(body)):
            raise UnsureError("it shows two bodies, one above the other; give each vertebra its own surface")
    low, high = body.min(axis=0), body.max(axis=0)
    up = np.array([0.0, 1.0])
    points = [[0.0, *leaving(body, (low + high) / 2.0, sign * up)] for sign in (1.0, -1.0)]
    depth, pedicles = _pedicles(local, low, high)
    for pedicle in pedicles:
        centre = centroid(pedicle)
        for sign in (1.0, -1.0):
            left, height = leaving(pedicle, centre, sign * up)
            points.append([left, depth, height])
    return np.array(points)


def _pedicles(local: Surface, low: np.ndarray, high: np.ndarray) -> tuple[float, tuple[np.ndarray, np.ndarray]]:
    """Where behind the body the pedicles are narrowest, both together, and their sections there.

    low, high: corners of the body's outline, back and up.
    """
    sections: list[tuple[float, tuple[np.ndarray, np.ndarray]]] = []
    sizes: list[float] = []
    missing, uneven = {"left", "right"}, ""
    for depth in high[0] + np.arange(0.5, _BEHIND * (high[0] - low[0]), 0.5):
        parts = coronal(local, float(depth))
        left, right = (_pedicle(parts, side, low[1], high[1]) for side in (1.0, -1.0))
        missing -= {word for word, part in (("left", left), ("right", right)) if part is not None}
        unlike = "" if left is None or right is None else unevenness(_size(left), _size(right))
        uneven = uneven or unlike
        if left is not None and right is not None and not unlike:
            sizes.append(abs(enclosed_area(left)) + abs(enclosed_area(right)))
            if sizes[-1] > _RISE * min(sizes):
                sizes.pop()
                break
            sections.append((float(depth), (left, right)))
        elif sections:
            break  # the arch begins
    if not sections and uneven:
        raise UnsureError(f"{uneven}; is it whole, and finely enough segmented?")
    if not sections:
        which = f"{min(missing)} pedicle" if len(missing) == 1 else "pedicles"
        raise UnsureError(f"no {which} behind its body; is the arch joined to the body?")
    narrow = np.flatnonzero(np.array(sizes) < _FLAT * min(sizes))
    return sections[narrow[len(narrow) // 2]]


def _size(pedicle: np.ndarray) -> np.ndarray:
    """Distance of a pedicle's section from the median plane, and its height [mm], shape (2,)."""
    return np.array([abs(centroid(pedicle)[0]), np.ptp(pedicle[:, 1])])


def unevenness(left: np.ndarray, right: np.ndarray) -> str:
    """How two opposite pedicles differ, where they do: by their distances and heights [mm], shape (2,)."""
    for what, one_side, other_side in zip(("from the median plane", "high"), left, right, strict=True):
        if min(one_side, other_side) < _UNEVEN * max(one_side, other_side):
            return f"its left pedicle is {one_side:.0f} mm {what} and its right one {other_side:.0f} mm"
    return ""


def _pedicle(parts: list[np.ndarray], side: float, bottom: float, top: float) -> np.ndarray | None:
    """The part of a coronal section next to the canal on one side, at the height of the body's upper half."""
    beside = [part for part in parts if (side * part[:, 0]).min() > 0.0]
    level = [part for part in beside if part[:, 1].min() < top and part[:, 1].max() > (bottom + top) / 2.0]
    if not level:
        return None
    part = outline(min(level, key=lambda part: (side * part[:, 0]).min()))
    from_middle, height = side * part[:, 0], np.ptp(part[:, 1])
    widest = np.minimum(from_middle, from_middle.min() + _WIDEST * height)
    return np.column_stack([side * widest, part[:, 1]])
