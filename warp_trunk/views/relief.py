"""A trunk as a relief: its depth and its slope, seen from one side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from warp_trunk.case.landmarks import Landmarks
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
    parts, count = [skin, *(cloth or ())], len(skin.vertices)
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)])
    vertices = seen_from(np.concatenate([part.vertices for part in parts]), landmarks, view)
    face, weights = _first_hits(vertices, faces.astype(np.int32), seen)
    weights[face < 0] = np.nan
    corners = faces[face]
    depth = np.einsum("ijk,ijk->ij", weights, vertices[:, 1][corners])
    normal = unit(np.einsum("ijk,ijkl->ijl", weights, vertex_normals(Surface(vertices, faces))[corners]))
    material = np.searchsorted(starts[1:-1], corners[:, :, 0], side="right")
    weights[material > 0] = np.nan
    corners = np.where(corners < count, corners, 0)
    spine = seen_from(landmarks.middles(), landmarks, view)[:, [0, 2]]
    return Relief(depth, normal, spine, corners, weights, material)


def _first_hits(vertices: np.ndarray, faces: np.ndarray, seen: Window) -> tuple[np.ndarray, np.ndarray]:
    """The face seen in each pixel, -1 for none, and the weights of its corners (rows, columns, 3)."""
    import warp as wp

    from warp_trunk.geometry.core_threads import launch_over_cores
    from warp_trunk.geometry.distance_field import search_tree
    from warp_trunk.kernels.surface import first_hit

    near, far = vertices[:, 1].max() + 1.0, vertices[:, 1].min() - 1.0
    towards = np.flatnonzero(area_vectors(vertices, faces)[:, 1] > 0.0)  # a ray enters by these alone
    mesh, middle = search_tree(Surface(vertices, faces[towards]))
    shape = (len(seen.z), len(seen.x))
    face: Any = wp.zeros(shape, dtype=wp.int32, device="cpu")
    weights = wp.zeros(shape, dtype=wp.vec3, device="cpu")
    right, down, forward = wp.vec3(-seen.pixel, 0.0, 0.0), wp.vec3(0.0, 0.0, -seen.pixel), wp.vec3(0.0, -1.0, 0.0)
    corner = wp.vec3(*(np.array([seen.x[0], near, seen.z[0]]) - middle))
    inputs = [mesh.id, corner, right, down, forward, float(near - far)]
    launch_over_cores(first_hit, face.size, inputs, [face, weights])
    return np.append(towards, -1)[face.numpy()], weights.numpy().astype(np.float64)
