"""The derivative of a measured number, and how a point of a section passes it on to the skin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

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
