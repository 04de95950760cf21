"""How measures of the skin change when its vertices and the landmarks move by a little."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .back_rotation import DualTangent, find_contacts
from .hump import hump_top
from .shoulders import upper_outline
from .spine import asis_axis, spine_of

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.geometry.surface import Surface


@dataclass(frozen=True, eq=False)
class Derivative:
    """A number measured on a skin with its landmarks, and how it changes with both."""

    value: float
    """The number, in its own unit."""
    vertices: np.ndarray
    """Its derivative in the place of each vertex of the skin [unit/mm], shape (vertices, 3)."""
    landmarks: np.ndarray
    """Its derivative in the place of each landmark, the skin as it is [unit/mm], shape (landmarks, 3)."""


def point_derivative(skin: Surface, landmarks: Landmarks, vertex: int, direction: np.ndarray) -> Derivative:
    """How far a vertex of the skin stands along a unit vector (3,) [mm]."""
    vertices = np.zeros_like(skin.vertices)
    vertices[vertex] = direction
    return Derivative(float(skin.vertices[vertex] @ direction), vertices, np.zeros_like(landmarks.points))


class Level:
    """The horizontal section of a skin at a vertebra, of which derivatives are collected."""

    def __init__(self, skin: Surface, landmarks: Landmarks, level: str) -> None:
        self.landmarks = landmarks
        self.level = level
        self.by_vertex = np.zeros_like(skin.vertices)
        self.by_landmark = np.zeros_like(landmarks.points)
        self._rows = [row for row, name in enumerate(landmarks.names) if name.startswith(f"{level}_")]
        height = landmarks.points[self._rows].mean(axis=0)[2]
        z = skin.vertices[:, 2]
        above = z[skin.faces] >= height
        cut = skin.faces[above.any(axis=1) & ~above.all(axis=1)]
        edges = np.concatenate([cut[:, [0, 1]], cut[:, [1, 2]], cut[:, [2, 0]]])
        self._edges = edges = edges[(z[edges[:, 0]] >= height) != (z[edges[:, 1]] >= height)]
        start, end = skin.vertices[edges[:, 0]], skin.vertices[edges[:, 1]]
        self._shares = (height - start[:, 2]) / (end[:, 2] - start[:, 2])
        self._points = start[:, :2] + self._shares[:, None] * (end[:, :2] - start[:, :2])
        self._leans = (end[:, :2] - start[:, :2]) / (end[:, 2] - start[:, 2])[:, None]

    def add_point(self, point: np.ndarray, weight: np.ndarray) -> None:
        """Adds the derivative of weight . (a point of the outline), x and y; it moves on its edge of the skin."""
        edge = int(np.argmin(((self._points - point) ** 2).sum(axis=1)))
        share, along_z = self._shares[edge], float(weight @ self._leans[edge])
        pull = np.array([*weight, -along_z])
        start, end = self._edges[edge]
        self.by_vertex[start] += (1.0 - share) * pull
        self.by_vertex[end] += share * pull
        self.add_centroid(np.array([0.0, 0.0, along_z]))

    def add_centroid(self, weight: np.ndarray) -> None:
        """Adds the derivative of weight . (the centroid of the vertebra), (3,)."""
        add_centroid(self.by_landmark, self._rows, weight)

    def add_turn(self, weight: float) -> None:
        """Adds the derivative of weight * (the angle of the pelvis' axis, counterclockwise [radians])."""
        add_turn(self.by_landmark, self.landmarks, weight)

    def derivative(self, value: float) -> Derivative:
        """The collected derivative of a number."""
        return Derivative(value, self.by_vertex, self.by_landmark)


def add_centroid(by_landmark: np.ndarray, rows: list[int], weight: np.ndarray) -> None:
    """Adds weight . (the mean of some landmarks), (3,), to a derivative."""
    by_landmark[rows] += weight / len(rows)


def add_turn(by_landmark: np.ndarray, landmarks: Landmarks, weight: float) -> None:
    """Adds weight * (the angle from the x axis to the axis from right to left iliac spine) to a derivative."""
    left, right = landmarks.index("asis_left"), landmarks.index("asis_right")
    x, y = (landmarks.points[left] - landmarks.points[right])[:2]
    across = weight * np.array([-y, x]) / (x * x + y * y)
    by_landmark[left, :2] += across
    by_landmark[right, :2] -= across


def rotation_derivative(skin: Surface, landmarks: Landmarks, level: str, tangent: DualTangent) -> Derivative:
    """Back surface rotation at a level [degrees], and how it changes.

    A tangent stays on its points of contact as they move by a little: to first order, points beside them do not
    count. Over a groove those are two corners of the outline. Where the back is convex the points lie on two edges
    of the hull at +-`SPAN`/2 from the spine along the tangent, and slide on these edges as it turns: with slopes k
    of the edges against the tangent, whose distance from the spine is d, a turn a of the tangent satisfies
    (|T| + d (k_l - k_r)) a = (n - k_l t) . dl - (n - k_r t) . dr for motions dl, dr of the points with the edges.

    Args:
        skin: the surface that was measured [mm].
        landmarks: those that it was measured with [mm].
        level: the vertebra.
        tangent: what was found there (`back_surface_rotation`).
    """
    found = Level(skin, landmarks, level)
    contacts = find_contacts(tangent.outline - tangent.spine, tangent.across)
    assert contacts is not None  # where there is a tangent there are contacts
    between = contacts.points[0] - contacts.points[1]
    span = math.hypot(*between)
    along = between / span
    normal = np.array([-along[1], along[0]])
    distance = contacts.points.mean(axis=0) @ normal
    ways = contacts.edges[:, 1] - contacts.edges[:, 0]
    slopes = np.zeros(2) if contacts.bridge else (ways @ normal) / (ways @ along)
    stretch = span + distance * (slopes[0] - slopes[1])
    for ends, share, slope, side in zip(contacts.edges, contacts.shares, slopes, (1.0, -1.0), strict=True):
        weight = -math.degrees(1.0) * side * (normal - slope * along) / stretch
        for end, part in zip(ends, (1.0 - share, share), strict=True):
            if part:
                found.add_point(end + tangent.spine, part * weight)
        found.add_centroid(-np.array([*weight, 0.0]))
    found.add_turn(math.degrees(1.0))
    return found.derivative(tangent.angle)


def hump_derivative(skin: Surface, landmarks: Landmarks, level: str, tangent: DualTangent) -> Derivative | None:
    """Height of the hump at a level [mm], and how it changes; None where there is none (`hump_height`).

    The top stays the same corner of the outline as it moves by a little; the other side is followed where it is as
    far from the spine. Arguments as for `rotation_derivative`.
    """
    top = hump_top(tangent)
    if top is None:
        return None
    found = Level(skin, landmarks, level)
    across = tangent.across
    backward = np.array([-across[1], across[0]])
    points = tangent.outline - tangent.spine
    aside, back = points @ across, points @ backward
    by_aside, by_back = np.zeros(len(points)), np.zeros(len(points))
    for place, side in ((top.right, 1.0), (top.left, -1.0)):
        parts = np.array([1.0 - place.share, place.share])
        first, second = place.beside
        way = aside[first] - aside[second]
        slope = 0.0 if way == 0.0 else (back[place.points[1]] - back[place.points[0]]) / way  # to the right
        np.add.at(by_back, list(place.points), side * parts)
        np.add.at(by_aside, [first, second], side * slope * parts)
        if top.corner is not None:  # both sides are followed at its distance |aside|
            by_aside[top.corner] += slope * np.sign(aside[top.corner])
    for point in np.flatnonzero((by_aside != 0.0) | (by_back != 0.0)):
        weight = by_aside[point] * across + by_back[point] * backward
        found.add_point(tangent.outline[point], weight)
        found.add_centroid(-np.array([*weight, 0.0]))
    found.add_turn(float(by_aside @ back - by_back @ aside))
    return found.derivative(top.height)


def shoulder_derivative(skin: Surface, landmarks: Landmarks) -> Derivative | None:
    """How much higher the right shoulder stands [mm], and how that changes; None where it is missing.

    The highest edge of the skin at each place stays the same as it moves by a little; the places move with the
    edge of the narrower shoulder (`shoulder_heights`).

    Args:
        skin: the surface to measure [mm].
        landmarks: those that go with it [mm].
    """
    across = asis_axis(landmarks)
    outline = upper_outline(skin, spine_of(landmarks), across)
    if outline is None:
        return None
    aside, above, shares, ends = outline.aside, outline.above, outline.shares, outline.ends
    count = outline.places.shape[1]
    by_aside, by_above = np.zeros(len(aside)), np.zeros(len(aside))
    slope = (above[ends[..., 1]] - above[ends[..., 0]]) / (aside[ends[..., 1]] - aside[ends[..., 0]])
    sign = np.array([[-1.0], [1.0]]) / count
    for end, part in enumerate((1.0 - shares, shares)):
        np.add.at(by_above, ends[..., end], sign * part)
        np.add.at(by_aside, ends[..., end], -sign * part * slope)
    # each place is a fixed part of the distance of the outermost vertex
    by_aside[outline.edge] += float((sign * slope * outline.places / aside[outline.edge]).sum())
    vertices = np.column_stack([by_aside * across[0], by_aside * across[1], by_above])
    by_landmark = np.zeros_like(landmarks.points)
    rows = [row for row, name in enumerate(landmarks.names) if name.startswith("T1_")]
    add_centroid(by_landmark, rows, -vertices.sum(axis=0))
    centre = landmarks.points[rows].mean(axis=0)
    forward = (skin.vertices[:, :2] - centre[:2]) @ np.array([-across[1], across[0]])
    add_turn(by_landmark, landmarks, float(by_aside @ forward))
    left, right = outline.heights.mean(axis=1)
    return Derivative(float(right - left), vertices, by_landmark)
