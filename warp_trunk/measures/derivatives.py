"""How measures of the skin change when its vertices and the landmarks move by a little."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.section import at_height, section, trunk_loop, turn
from warp_trunk.geometry.surface import Surface, compact
from warp_trunk.spine.spine import asis_axis, sacral_line, spine_of

from .back_rotation import DualTangent, contacts_beside, hump_height, hump_top, tangent_of
from .outlines import (
    CHEST,
    DEEP,
    SHALLOW,
    Shoulders,
    Silhouette,
    hollows,
    shoulder_heights,
    silhouette_of,
    upper_outline,
)
from .scoliometer import pedicle_turns, scoliometer_on, slope_between

Number = Callable[[Surface, Landmarks], float]
"""A number of a skin with its landmarks."""
DIFFERENCE_STEP = 1e-5
"""How far a vertex or landmark is moved [mm]."""
_NEAREST = 8
"""Edges of the section, each counted for both of its triangles, among which are those around a point."""
_ILIAC = ("asis_left", "asis_right")
_SACRAL = ("S1_", "sacrum_", "L5_inferior_endplate")
"""Landmarks of the sacral line."""
_MARGIN = 1.0
"""Triangles this near to a plane [mm] stay those that matter as landmarks move."""


@dataclass(frozen=True, eq=False)
class Derivative:
    """A number measured on a skin with its landmarks, and how it changes with both."""

    value: float
    """The number, in its own unit."""
    vertices: np.ndarray
    """Its derivative in the place of each vertex of the skin [unit/mm], shape (vertices, 3)."""
    landmarks: np.ndarray
    """Its derivative in the place of each landmark, the skin as it is [unit/mm], shape (landmarks, 3)."""


def rotation_derivative(skin: Surface, landmarks: Landmarks, level: str, tangent: DualTangent) -> Derivative:
    """Back surface rotation at a level [degrees], and how it changes with the points that the tangent touches.

    Args:
        skin: the surface that was measured [mm].
        landmarks: those that it was measured with [mm].
        level: the vertebra.
        tangent: what was found there (`back_surface_rotation`).
    """
    from scipy.spatial import KDTree  # heavy

    contacts, rows = tangent.contacts, landmarks.rows_of(level)
    bridge = np.array_equal(*contacts.edges)
    triangles, edges, cuts = _cut(skin, landmarks.points[rows, 2].mean())
    corners = np.concatenate([*contacts.edges, contacts.nearest])
    touched = edges[KDTree(cuts).query(corners)[1]]
    used = np.unique(skin.faces[triangles])

    def angle(part: Surface, marks: Landmarks) -> float:
        centroid = marks.points[rows].mean(axis=0)
        left, right, nearest = at_height(part.vertices[np.searchsorted(used, touched)], centroid[2]).reshape(
            3, 2, 2
        )
        beside = np.stack([left, right])
        contacts = None if bridge else contacts_beside(centroid[:2], nearest, lambda *_: beside)
        points = left if bridge else np.full((2, 2), np.nan) if contacts is None else contacts.points
        return -math.degrees(turn(asis_axis(marks), points[0] - points[1]))

    return _by_differences(angle, tangent.angle, skin, landmarks, triangles, touched.ravel(), rows)


def hump_derivative(skin: Surface, landmarks: Landmarks, level: str, tangent: DualTangent) -> Derivative | None:
    """Height of the hump at a level [mm], and how it changes; None where there is none (`hump_height`).

    Arguments as for `rotation_derivative`.
    """
    from scipy.spatial import KDTree  # heavy

    top = hump_top(tangent)
    if top is None:
        return None
    rows = landmarks.rows_of(level)
    triangles, edges, cuts = _cut(skin, landmarks.points[rows, 2].mean())
    longest = np.linalg.norm(np.subtract(*skin.vertices[edges].swapaxes(0, 1)), axis=1).max()
    near = np.concatenate(KDTree(cuts).query_ball_point(top[1], longest)).astype(int)

    def height(part: Surface, marks: Landmarks) -> float:
        centroid = marks.points[rows].mean(axis=0)
        outline = trunk_loop(section(part, float(centroid[2])), centroid[:2])
        tangent_here = None if outline is None else tangent_of(outline, centroid, asis_axis(marks))
        hump = None if tangent_here is None else hump_height(tangent_here)
        return np.nan if hump is None else hump

    return _by_differences(height, top[0], skin, landmarks, triangles, edges[near].ravel(), rows)


def slope_derivative(skin: Surface, landmarks: Landmarks, level: str, slope: float) -> Derivative | None:
    """The slope of the standing back at a level [degrees], and how it changes; None where it is missing.

    Args:
        skin: the surface that is measured [mm].
        landmarks: those that go with it [mm].
        level: the vertebra.
        slope: what was measured there (`slopes_of`).
    """
    from scipy.spatial import KDTree  # heavy

    rows = landmarks.rows_of(level)
    triangles, edges, cuts = _cut(skin, landmarks.points[rows, 2].mean())

    def places(part: Surface, marks: Landmarks) -> np.ndarray | None:
        own = spine_of(Landmarks(tuple(marks.names[row] for row in rows), marks.points[rows]))
        across, centre = asis_axis(marks), own.centroids[0]
        outline = trunk_loop(section(part, float(centre[2])), centre[:2])
        turned = float(pedicle_turns(own, across)[0])
        return None if outline is None else scoliometer_on(outline, centre[:2], across, turned, level)

    ends_before = places(skin, landmarks)
    if ends_before is None:
        return None

    def angle(part: Surface, marks: Landmarks) -> float:
        ends = places(part, marks)
        return np.nan if ends is None else slope_between(ends, asis_axis(marks))

    near = np.unique(KDTree(cuts).query(ends_before, k=min(_NEAREST, len(cuts)))[1])
    return _by_differences(angle, slope, skin, landmarks, triangles, edges[near].ravel(), *([row] for row in rows))


def shoulder_derivatives(skin: Surface, landmarks: Landmarks, shoulders: Shoulders) -> dict[str, Derivative]:
    """How much higher the right shoulder stands [mm] and the angle of both [degrees], and how these change.

    Args:
        skin: the surface that was measured [mm].
        landmarks: those that it was measured with [mm].
        shoulders: the heights that were measured (`shoulder_heights`).

    Returns:
        By quantity.
    """
    outline = upper_outline(skin, spine_of(landmarks), asis_axis(landmarks))
    assert outline is not None  # where there are heights there is an outline

    def number(name: str) -> Number:
        def of(part: Surface, marks: Landmarks) -> float:
            moved = shoulder_heights(part, spine_of(marks), asis_axis(marks))
            return np.nan if moved is None else getattr(moved, name)

        return of

    rows = landmarks.rows_of("T1")
    low = landmarks.points[rows, 2].mean() - DEEP - _MARGIN
    triangles = (skin.vertices[skin.faces, 2] > low).all(axis=1)
    touched = [*outline.ends.ravel(), outline.edge]
    return {
        key: _by_differences(number(name), getattr(shoulders, name), skin, landmarks, triangles, touched, rows)
        for key, name in (("shoulder_difference_mm", "difference"), ("clavicle_angle_deg", "angle"))
    }


WAIST = {
    "waist_depth_mm": "depth_difference",
    "waist_height_mm": "height_difference",
    "waist_height_angle_deg": "height_angle",
    "waist_angle_ratio_percent": "angle_ratio",
    "waistline_depth_ratio_percent": "depth_ratio",
}
"""Which number of a `Waist` each quantity is."""


def waist_derivatives(skin: Surface, landmarks: Landmarks) -> dict[str, Derivative]:
    """The quantities of the waist (`WAIST`), and how they change; empty where it is missing, or where a side has
    no hollow.

    Args:
        skin: the surface to measure [mm].
        landmarks: those that go with it [mm].

    Returns:
        By quantity.
    """

    def outline_of(marks: Landmarks) -> Silhouette | None:
        pelvis = float(np.mean([marks.point(name)[2] for name in _ILIAC]))
        return silhouette_of(skin, spine_of(marks), sacral_line(marks), pelvis)

    def numbers(outline: Silhouette) -> np.ndarray:
        waist = hollows(outline)
        return np.array([getattr(waist, name) for name in WAIST.values()], dtype=float)

    outline, line = outline_of(landmarks), sacral_line(landmarks)
    if outline is None:
        return {}
    heights, widths = outline.heights, outline.widths
    waist = hollows(outline)
    if min(waist.left_depth, waist.right_depth) <= SHALLOW:
        return {}
    values = numbers(outline)
    by_vertex = np.zeros((len(WAIST), *skin.vertices.shape))
    for side, row in product(range(2), range(len(heights))):
        moved = widths.copy()
        moved[side, row] += DIFFERENCE_STEP
        by_width = (numbers(replace(outline, widths=moved)) - values) / DIFFERENCE_STEP
        edge = outline.edges[side, row]
        (a, b), (z_a, z_b) = (skin.vertices[edge, :2] - line.point) @ line.across, skin.vertices[edge, 2]
        share = (heights[row] - z_a) / (z_b - z_a)
        for vertex, part in zip(edge, (1.0 - share, share), strict=True):
            along = [*(part * line.across), -part * (b - a) / (z_b - z_a)]  # the cut moves along the edge
            by_vertex[:, vertex] += (by_width if side == 0 else -by_width)[:, None] * along
    by_landmark = np.zeros((len(WAIST), *landmarks.points.shape))
    for row, axis in product(range(len(landmarks.points)), range(3)):
        if not landmarks.names[row].startswith((CHEST, *_SACRAL, *_ILIAC)):
            continue
        points = landmarks.points.copy()
        points[row, axis] += DIFFERENCE_STEP
        moved_outline = outline_of(replace(landmarks, points=points))
        if moved_outline is not None and len(moved_outline.heights) == len(heights):
            by_landmark[:, row, axis] = (numbers(moved_outline) - values) / DIFFERENCE_STEP
    return {name: Derivative(float(values[i]), by_vertex[i], by_landmark[i]) for i, name in enumerate(WAIST)}


def _cut(skin: Surface, height: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which triangles are near a horizontal plane, the edges (n, 2) that it cuts, and where, (n, 2) [mm]."""
    z = skin.vertices[:, 2]
    triangles = (z[skin.faces].min(axis=1) < height + _MARGIN) & (z[skin.faces].max(axis=1) > height - _MARGIN)
    edges = np.concatenate([skin.faces[triangles][:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    edges = edges[(z[edges[:, 0]] >= height) != (z[edges[:, 1]] >= height)]
    return triangles, edges, at_height(skin.vertices[edges], height)


def _by_differences(
    number: Number,
    value: float,
    skin: Surface,
    landmarks: Landmarks,
    triangles: np.ndarray,
    vertices: Sequence[int] | np.ndarray,
    *groups: Sequence[int],
) -> Derivative:
    """A measured value with differences of its number on some triangles, in some vertices and the iliac spines,
    and in groups of landmarks, of each of which the mean counts."""
    part, used = compact(skin.vertices, skin.faces[triangles]), np.unique(skin.faces[triangles])
    derivative = Derivative(value, np.zeros_like(skin.vertices), np.zeros_like(landmarks.points))
    start = number(part, landmarks)  # of some triangles; rounded otherwise than the value

    def slope(rows: Sequence[int], axis: int, points: np.ndarray, by_skin: bool) -> float:
        moved = points.copy()
        moved[rows, axis] += DIFFERENCE_STEP
        state = (Surface(moved, part.faces), landmarks) if by_skin else (part, replace(landmarks, points=moved))
        return (number(*state) - start) / DIFFERENCE_STEP

    for vertex, axis in product(np.unique(vertices).tolist(), range(3)):
        derivative.vertices[vertex, axis] = slope([int(np.searchsorted(used, vertex))], axis, part.vertices, True)
    spines = [landmarks.index(name) for name in _ILIAC]
    for together, axis in product([*groups, spines[:1], spines[1:]], range(3)):
        derivative.landmarks[together, axis] = slope(together, axis, landmarks.points, False) / len(together)
    return derivative
