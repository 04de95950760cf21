"""Horizontal sections of a surface, and the part of one that is the trunk's own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from warp_trunk.errors import InputError

from .surface import Surface, unit


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
    return sections(surface, [height])[0]


def sections(surface: Surface, heights: Sequence[float]) -> list[list[np.ndarray]]:
    """Cut a closed surface by planes at some heights [mm], all in one pass over its triangles.

    For each plane what `section` gives, and raises.
    """
    order = np.argsort(heights)
    plane, points, following = _cut(surface, np.asarray(heights, dtype=np.float64)[order])
    repeated = (points[following] == points).all(axis=1)
    loops: list[list[np.ndarray]] = [[] for _ in heights]
    for cycle in _cycles(following):
        once = cycle[~repeated[cycle]]
        if len(once) >= 3:
            loops[order[plane[cycle[0]]]].append(points[once])
    return loops


def pieces(surface: Surface, height: float) -> list[np.ndarray]:
    """The connected pieces of the cut of a surface, open or closed, by the plane z = height [mm].

    Returns the segments of each piece, x and y [mm], shape (segments, 2, 2), in no order; none where the plane
    misses the surface.
    """
    from .surface_checks import linked_parts

    z = surface.vertices[:, 2]
    faces = surface.faces[(z[surface.faces].min(axis=1) < height) & (z[surface.faces].max(axis=1) >= height)]
    if not len(faces):
        return []
    sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2)  # (faces, 3, 2)
    sides = np.sort(sides[(z[sides[:, :, 0]] < height) != (z[sides[:, :, 1]] < height)].astype(np.int64), axis=1)
    edges, segments = np.unique(sides, axis=0, return_inverse=True)
    segments = segments.reshape(-1, 2)  # a triangle is cut at two of its sides
    points = at_height(surface.vertices[edges], height)
    part = linked_parts(segments[:, 0], segments[:, 1], len(edges))[segments[:, 0]]
    return [points[segments[part == number]] for number in range(part.max() + 1)]


def at_height(ends: np.ndarray, height: float) -> np.ndarray:
    """The points (edges, 2) at a height on edges from their ends (edges, 2, 3) [mm]."""
    start, way = ends[:, 0], ends[:, 1] - ends[:, 0]
    return (start + ((height - start[:, 2]) / way[:, 2])[:, None] * way)[:, :2]


def trunk_loop(loops: list[np.ndarray], spine: np.ndarray) -> np.ndarray | None:
    """Of several loops (arms give some too) the largest around the spine (2,) [mm]; None if none is.

    A single loop is taken as it is.
    """
    around = loops if len(loops) == 1 else [loop for loop in loops if encloses(loop, spine)]
    return around[0] if len(around) == 1 else max(around, key=lambda loop: abs(enclosed_area(loop)), default=None)


def enclosed_area(loop: np.ndarray) -> float:
    """Area inside a closed loop (k, 2) [mm^2], positive if it turns counterclockwise."""
    x, y = (loop - loop.mean(axis=0)).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def encloses(loop: np.ndarray, point: np.ndarray) -> bool:
    """Whether a loop (k, 2) goes round a point (2,)."""
    return bool(inside(point[None], loop, np.roll(loop, -1, axis=0))[0])


def inside(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Which points (n, 2) a ray to the right leaves across an odd number of the edges from start to end, (k, 2)
    each, of closed outlines; bool, shape (n,)."""
    x, y = points.T[:, :, None]
    (x0, y0), (x1, y1) = start.T, end.T
    with np.errstate(divide="ignore", invalid="ignore"):  # of edges that no such ray crosses
        right = x < x0 + (y - y0) * (x1 - x0) / (y1 - y0)
    return np.count_nonzero(right & ((y0 > y) != (y1 > y)), axis=1) % 2 == 1


def crossed(steps: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each triangle (3, triangles) whose corners are on several steps, and each step below its highest corner."""
    first, second, third = (steps.take(corner) for corner in corners)
    least = np.minimum(np.minimum(first, second), third)
    times = np.maximum(np.maximum(first, second), third) - least
    face = np.flatnonzero(times)
    times = times[face].astype(np.int64)
    step = np.arange(times.sum()) + np.repeat(least[face] - (np.cumsum(times) - times), times)
    return np.repeat(face, times), step


def _cut(surface: Surface, planes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Every edge that one of the planes, in rising order, cuts: plane (k,), x and y (k, 2), next edge (k,)."""
    vertices, faces = surface.vertices, surface.faces
    # a vertex is above the first `above` planes, so those cut a triangle that lie between its least and its most
    above = np.searchsorted(planes, vertices[:, 2], side="right").astype(np.int16)
    face, plane = crossed(above, faces.T)
    p, q, r = faces[face].astype(np.int64).T
    # turn each triangle so that its lonely corner a comes first: the cut joins the two edges at that corner
    p_up, q_up, r_up = above[p] > plane, above[q] > plane, above[r] > plane
    p_lonely, q_lonely = q_up == r_up, r_up == p_up
    a, b, c = (
        np.where(p_lonely, of_p, np.where(q_lonely, of_q, of_r))
        for of_p, of_q, of_r in ((p, q, r), (q, r, p), (r, p, q))
    )
    rising = above[a] > plane
    # the inside is to the left of the direction of travel, the face normal to the right
    out, into = np.where(rising, b, c), np.where(rising, c, b)
    leave, enter = (_edge_key(plane, a, other, len(vertices)) for other in (out, into))
    by_leave, by_enter = np.argsort(leave), np.argsort(enter)
    keys, plane = leave[by_leave], plane[by_leave]
    wrong = keys != enter[by_enter]
    wrong[1:] |= keys[1:] == keys[:-1]
    if wrong.any():
        raise InputError(
            "section: the surface must be closed and oriented where it is cut, at "
            f"z = {planes[plane[wrong.argmax()]]:g} mm; repair the surface"
        )
    rank = np.empty(len(keys), dtype=np.int64)
    rank[by_enter] = np.arange(len(keys))
    start, end, height = vertices[a[by_leave]], vertices[out[by_leave]], planes[plane]
    share = (height - start[:, 2]) / (end[:, 2] - start[:, 2])
    points = start[:, :2] + share[:, None] * (end[:, :2] - start[:, :2])
    at_end = end[:, 2] == height
    points[at_end] = end[at_end, :2]  # to the bit, so that repeats are seen
    return plane, points, rank[by_leave]


def _edge_key(plane: np.ndarray, first: np.ndarray, second: np.ndarray, count: int) -> np.ndarray:
    """One number for an edge at a plane, the same from both of its faces."""
    return (plane * count + np.minimum(first, second)) * count + np.maximum(first, second)


def _cycles(following: np.ndarray) -> list[np.ndarray]:
    """The cycles of a permutation."""
    after: list[int] = following.tolist()  # Python reads its own lists several times faster than arrays
    left = [True] * len(after)
    cycles = []
    for start in range(len(after)):
        if not left[start]:
            continue
        cycle, edge = [], start
        while left[edge]:
            left[edge] = False
            cycle.append(edge)
            edge = after[edge]
        cycles.append(np.array(cycle))
    return cycles


def last_crossing(segments: np.ndarray, start: np.ndarray, direction: np.ndarray) -> np.ndarray | None:
    """Where the line from a point (2,) in a direction crosses segments (n, 2, 2) furthest along, shape (2,); None
    where it misses all of them."""
    direction = unit(direction)
    aside = (segments - start) @ np.array([direction[1], -direction[0]])
    crossed = (aside[:, 0] >= 0.0) != (aside[:, 1] >= 0.0)
    if not crossed.any():
        return None
    before, after = aside[crossed].T
    first, second = np.moveaxis(segments[crossed] - start, 1, 0)
    way = (first + (before / (before - after))[:, None] * (second - first)) @ direction
    return start + way.max() * direction


def turn(a: np.ndarray, b: np.ndarray) -> float:
    """Angle from a to b, counterclockwise [radians]."""
    return math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1])


def upper_hull(x: np.ndarray, y: np.ndarray) -> list[int]:
    """The corners of the least concave curve over points (x, y), by the chain of Andrew (1979).

    Args:
        x: does not fall, shape (n,).
        y: shape (n,).

    Returns:
        Their rows, rising.
    """
    hull: list[int] = []
    xs, ys = x.tolist(), y.tolist()
    for point in range(len(xs)):
        while len(hull) > 1:
            first, last = hull[-2:]
            rise, run = ys[last] - ys[first], xs[last] - xs[first]
            if rise * (xs[point] - xs[first]) > run * (ys[point] - ys[first]):
                break
            hull.pop()
        hull.append(point)
    return hull


def arc_length(line: np.ndarray) -> np.ndarray:
    """How far each point of a line (n, ...) is from its first one along it [mm], shape (n,)."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))


def points_along(line: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """The points at some lengths (m,) [mm] along a line (n, k) from its first one, shape (m, k)."""
    way = arc_length(line)
    return np.column_stack([np.interp(lengths, way, column) for column in line.T])


SHOULDERS = ("T1", "T2", "T3", "T4")
"""Levels at which shoulders are the trunk's own."""
_NOTCH = 2.0
"""An outline is notched where it lies this deep under its convex hull [mm]."""
_LEAST_ARM_AREA = 1200.0
"""No arm has a smaller section [mm2]."""
_STANDS_OUT = 0.35
"""An arm has at least this area over the square of the line that cuts it off: half a disc has 0.39, the fold of
skin before a shoulder blade less than 0.1."""
_ASIDE = 0.5
"""An arm is cut off between notches at least this part of the trunk's narrower half from the spine: not at the
groove of the back."""
_FILLET, _SIDE = 6.0, 10.0
"""Beside a notch the skin turns into the arm over the first length [mm]; points the second apart show where it
goes."""
_MOST_ARM_SHARE = 0.4
"""An arm has less than this of the area of the trunk."""


def own_part(loop: np.ndarray, spine: np.ndarray) -> np.ndarray | None:
    """The part of an outline that is the trunk's, cut off from arms between notches in front of and behind them.

    Args:
        loop: outline of a section, x and y [mm], shape (points, 2), counterclockwise.
        spine: a point in the trunk [mm], shape (2,).

    Returns:
        The points of the trunk in their order, or None where all are the trunk's.
    """
    own = loop
    for _ in range(2):  # an arm on each side
        cut = _without_arm(own, spine)
        if cut is None:
            break
        own = cut
    return None if own is loop else own


def _without_arm(loop: np.ndarray, spine: np.ndarray) -> np.ndarray | None:
    """The outline without the part that stands out most; None where none does."""
    best, most = None, _STANDS_OUT
    middle = 0.5 * (loop.min(axis=0) + loop.max(axis=0))
    aside = loop[:, 0] - spine[0]
    aside /= min(aside.max(), -aside.min())  # an arm on one side does not widen the other half
    for first, second in combinations([n for n in _notches(loop) if abs(aside[n]) >= _ASIDE], 2):
        if aside[first] * aside[second] < 0.0:
            continue
        parts = loop[first : second + 1], np.vstack([loop[second:], loop[: first + 1]])
        areas = [enclosed_area(part) for part in parts]
        arm, trunk = (0, 1) if areas[0] < areas[1] else (1, 0)
        across, along = np.abs(parts[arm].mean(axis=0) - middle)
        chord = float(np.sum((loop[first] - loop[second]) ** 2))
        share = areas[arm] / max(chord, 1.0)
        size = _LEAST_ARM_AREA <= areas[arm] <= _MOST_ARM_SHARE * areas[trunk]
        if size and across > along and share > most and encloses(parts[trunk], spine):
            best, most = parts[trunk], share
    return None if best is None else _closed(best)


def _closed(open_outline: np.ndarray) -> np.ndarray:
    """The outline from one notch round the trunk to the other, closed by the flank that was under the arm: a cubic
    that goes on as the outline does beside the notches."""
    way, inward = arc_length(open_outline), _FILLET + _SIDE * np.arange(3.0)
    free = (way >= _FILLET) & (way <= way[-1] - _FILLET)
    start, before, long_before = points_along(open_outline, way[-1] - inward)
    end, after, long_after = points_along(open_outline, inward)
    # directions at both ends by parabolas through three points, of unit length, times the length between the ends
    scale = np.linalg.norm(end - start) / (2.0 * _SIDE)
    out = scale * (3.0 * start - 4.0 * before + long_before)
    into = scale * (4.0 * after - 3.0 * end - long_after)
    t = np.linspace(0.0, 1.0, 20)[:, None]
    flank = (1 + 2 * t) * (1 - t) ** 2 * start + t**2 * (3 - 2 * t) * end
    return np.vstack([open_outline[free], flank + t * (1 - t) ** 2 * out + t**2 * (t - 1) * into])


def _notches(loop: np.ndarray) -> list[int]:
    """The deepest point of the outline under each edge of its convex hull, where deep enough, rising."""
    from scipy.spatial import ConvexHull, QhullError  # heavy

    try:
        corners = np.sort(ConvexHull(loop).vertices)
    except QhullError:  # all points on a line
        return []
    turned = np.roll(loop, -corners[0], axis=0)
    size = np.diff(corners - corners[0], append=len(loop))
    under = np.repeat(np.arange(len(corners)), size)  # the edge that each point lies under
    start = loop[corners]
    edge = np.roll(start, -1, axis=0) - start
    x, y = (turned - start[under]).T
    depth = np.abs(edge[under, 0] * y - edge[under, 1] * x) / np.linalg.norm(edge, axis=1)[under]
    deepest = np.lexsort((-depth, under))[np.cumsum(size) - size]
    return sorted(((deepest[depth[deepest] >= _NOTCH] + corners[0]) % len(loop)).tolist())
