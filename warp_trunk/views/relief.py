"""A trunk as a relief: its depth and its slope, seen from one side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.section import crossed
from warp_trunk.geometry.surface import Surface, area_vectors, unit, vertex_normals
from warp_trunk.spine.spine import asis_axis

MARGIN = 10.0
"""Empty space around the trunk [mm]."""
BELOW = 30.0
"""How far below the iliac spines the pictures end [mm]: there the back does."""


@dataclass(frozen=True)
class Viewpoint:
    """From where a trunk is seen."""

    turn: int
    """How many quarter turns the viewer has walked from behind the patient, by the patient's right."""
    sides: tuple[str, str]
    """The directions on the left and on the right of the picture."""


BEHIND = Viewpoint(0, ("left", "right"))
RIGHT = Viewpoint(1, ("back", "front"))
FRONT = Viewpoint(2, ("right", "left"))
LEFT = Viewpoint(3, ("front", "back"))


@dataclass(frozen=True)
class Window:
    """The common frame of all pictures of a result: in the axes of a view, see `seen_from`."""

    x: np.ndarray
    """Columns of pixels from left to right [mm], falling, shape (columns,)."""
    z: np.ndarray
    """Rows of pixels from top to bottom [mm], shape (rows,)."""
    pixel: float
    """Width and height of a pixel [mm]."""

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top edge of the picture [mm]; left is the larger x, as seen from behind."""
        half = self.pixel / 2.0
        return self.x[0] + half, self.x[-1] - half, self.z[-1] - half, self.z[0] + half


@dataclass(frozen=True)
class Relief:
    """One skin seen straight from one side by parallel rays."""

    depth: np.ndarray
    """How near the skin is, from behind how far back (+y) against the iliac spines [mm], shape (rows, columns);
    NaN beside it."""
    normal: np.ndarray
    """Smooth unit normals, shape (rows, columns, 3); NaN beside the trunk."""
    spine: np.ndarray
    """Centroids of the vertebrae, x and z [mm], top to bottom, shape (vertebrae, 2)."""
    corners: np.ndarray
    """The vertices of the triangle in each pixel, shape (rows, columns, 3)."""
    weights: np.ndarray
    """Their weights there, same shape; NaN beside the trunk and where cloth hides the skin."""
    cloth: np.ndarray
    """The material that is seen: 0 skin, 1 shorts, 2 shirt, shape (rows, columns)."""

    def values(self, of_vertices: np.ndarray) -> np.ndarray:
        """The visible values of the vertices of the skin, a number for each, shape (rows, columns); else NaN."""
        return np.einsum("ijk,ijk->ij", self.weights, of_vertices[self.corners])

    def uppermost(self, rows: int) -> Relief:
        """Its first rows of pixels."""
        images = (self.depth, self.normal, self.corners, self.weights, self.cloth)
        depth, normal, corners, weights, cloth = (image[:rows] for image in images)
        return Relief(depth, normal, self.spine, corners, weights, cloth)


def in_pelvis(points: np.ndarray, landmarks: Landmarks) -> np.ndarray:
    """Points (n, 3) [mm] seen from the pelvis: x to the left along the axis through the anterior superior
    iliac spines, y back, z up as before; the middle between the spines is at x = y = 0.

    Raises:
        InputError: as `asis_axis`.
    """
    across = asis_axis(landmarks)
    middle = (landmarks.point("asis_left") + landmarks.point("asis_right"))[:2] / 2.0
    axes = np.array([across, [-across[1], across[0]]])
    return np.column_stack([(points[:, :2] - middle) @ axes.T, points[:, 2]])


def seen_from(points: np.ndarray, landmarks: Landmarks, view: Viewpoint) -> np.ndarray:
    """Points (n, 3) [mm] for a viewer: x to the left of the picture, y towards the viewer, z up; from behind
    these are the axes of the pelvis.

    Raises:
        InputError: as `asis_axis`.
    """
    x, y, z = in_pelvis(points, landmarks).T
    for _ in range(view.turn):
        x, y = y, -x
    return np.column_stack([x, y, z])


def window(poses: Sequence[tuple[Surface, Landmarks]], pixel: float, view: Viewpoint = BEHIND) -> Window:
    """The window that shows all trunks, with square pixels of a size in mm, as wide from every side; from behind
    and in front it is symmetric about the middle of the pelvis."""
    points = np.concatenate([in_pelvis(skin.vertices, landmarks) for skin, landmarks in poses])
    spines = [landmarks.point(name)[2] for _, landmarks in poses for name in ("asis_left", "asis_right")]
    (left, back, top), (right, front, lowest) = points.max(axis=0), points.min(axis=0)
    reach = max(left, -right, (back - front) / 2.0)
    half = int(np.ceil((reach + MARGIN) / pixel))
    middle = 0.0 if view.turn % 2 == 0 else (back + front) / 2.0 * (1.0 if view.turn == 1 else -1.0)
    bottom = max(lowest, min(spines) - BELOW)
    rows = int(np.ceil((top + MARGIN - bottom) / pixel)) + 1
    x = middle + pixel * np.arange(half, -half - 1, -1.0)
    return Window(x, top + MARGIN - pixel * np.arange(rows), pixel)


def relief(
    skin: Surface,
    landmarks: Landmarks,
    seen: Window,
    view: Viewpoint = BEHIND,
    cloth: tuple[Surface, Surface] | None = None,
) -> Relief:
    """Look straight at a skin.

    Args:
        skin: the skin [mm].
        landmarks: those that go with it [mm].
        seen: where to look.
        view: from where.
        cloth: shorts and shirt over it, either without triangles where it is not worn.

    Raises:
        InputError: as `asis_axis`.
    """
    parts = [skin, *(cloth or ())]
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)])
    vertices = seen_from(np.concatenate([part.vertices for part in parts]), landmarks, view)
    pixel, corners, weights = _drawn(vertices, faces, seen)
    normals = vertex_normals(Surface(vertices, faces))
    material = np.searchsorted(starts[1:-1], corners[:, 0], side="right")
    bare = material == 0

    def image(values: np.ndarray, beside: float) -> np.ndarray:
        whole = np.full((len(seen.z) * len(seen.x), *values.shape[1:]), beside, values.dtype)
        whole[pixel] = values
        return whole.reshape(len(seen.z), len(seen.x), *values.shape[1:])

    return Relief(
        image(np.einsum("ij,ij->i", weights, vertices[:, 1][corners]), np.nan),
        image(unit(np.einsum("ij,ijk->ik", weights, normals[corners])), np.nan),
        seen_from(landmarks.middles(), landmarks, view)[:, [0, 2]],
        image(np.where(bare[:, None], corners, 0), 0),
        image(np.where(bare[:, None], weights, np.nan), np.nan),
        image(material, 0),
    )


def _drawn(vertices: np.ndarray, faces: np.ndarray, seen: Window) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The nearest triangle in each pixel that shows one.

    Each triangle that faces the viewer is drawn row by row, from its side between the uppermost and the lowest
    corner to the other two sides, and of several in a pixel the nearest stays.

    Returns:
        Numbers of the pixels, row after row, shape (k,), and the corners of their triangles with the weights of
        these there, shape (k, 3) each.
    """
    rows, columns = len(seen.z), len(seen.x)
    row, column = (seen.z[0] - vertices[:, 2]) / seen.pixel, (seen.x[0] - vertices[:, 0]) / seen.pixel
    corners = faces[area_vectors(vertices, faces)[:, 1] > 0.0]
    corners = np.take_along_axis(corners, np.argsort(row[corners], axis=1), axis=1)
    triangle, line = crossed(np.clip(np.ceil(row), 0, rows).astype(np.int64), corners.T)
    top, middle, low = corners[triangle].T
    whole, upper, lower = (
        (line - row[start]) / np.maximum(row[end] - row[start], 1e-300)
        for start, end in ((top, low), (top, middle), (middle, low))
    )
    above, none = line < row[middle], np.zeros(len(line))
    first = np.column_stack([1.0 - whole, none, whole])
    last = np.where(above, [1.0 - upper, upper, none], [none, 1.0 - lower, lower]).T
    start, end = (np.einsum("ij,ij->i", side, column[corners[triangle]]) for side in (first, last))
    left, right = (np.clip(np.ceil(place(start, end)), 0, columns) for place in (np.minimum, np.maximum))
    count = (right - left).astype(np.int64)
    span = np.repeat(np.arange(len(line)), count)
    place = np.arange(len(span)) - np.repeat(np.cumsum(count) - count - left.astype(np.int64), count)
    part = (place - start[span]) / (end - start)[span]
    weights = first[span] + part[:, None] * (last - first)[span]
    corners, pixel = corners[triangle[span]], line[span] * columns + place
    depth, nearest = np.einsum("ij,ij->i", weights, vertices[:, 1][corners]), np.full(rows * columns, -np.inf)
    np.maximum.at(nearest, pixel, depth)
    shown = depth == nearest[pixel]
    return pixel[shown], corners[shown], weights[shown]
