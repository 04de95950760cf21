"""The back as a relief: its depth seen from straight behind, and how far one side stands behind the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.geometry.normals import vertex_normals
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures.spine import asis_axis

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks

MARGIN = 10.0
"""Empty space around the trunk [mm]."""
BELOW = 30.0
"""How far below the iliac spines the pictures end [mm]: there the back does."""
FLANK, BACK = 0.6, 0.8
"""Where the skin faces back by less than the first it is flank, and not compared with the other side; by
more than the second it is back. Cosines of 53 and 37 degrees."""

NEAR, WIDE = 95.0, 115.0
"""Nearer to the spine than the first all of the skin is back; further than the second it is arm or flank [mm]."""


@dataclass(frozen=True)
class Window:
    """What all pictures of a result show, so that they compare: in the axes of the pelvis, see `in_pelvis`."""

    x: np.ndarray
    """Columns of pixels from the patient's left to right [mm], symmetric about 0, shape (columns,)."""
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
    """One skin seen from straight behind by parallel rays."""

    depth: np.ndarray
    """How far back (+y) the skin stands against the iliac spines [mm], shape (rows, columns); NaN beside it."""
    normal: np.ndarray
    """Smooth unit normals, shape (rows, columns, 3); NaN beside the trunk."""
    spine: np.ndarray
    """Centroids of the vertebrae, x and z [mm], top to bottom, shape (vertebrae, 2)."""


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


def window(poses: Sequence[tuple[Surface, Landmarks]], pixel: float = 0.75) -> Window:
    """The window that shows all backs, with square pixels of a size in mm."""
    points = np.concatenate([in_pelvis(skin.vertices, landmarks) for skin, landmarks in poses])
    spines = [landmarks.point(name)[2] for _, landmarks in poses for name in ("asis_left", "asis_right")]
    half = int(np.ceil((np.abs(points[:, 0]).max() + MARGIN) / pixel))
    bottom, top = max(points[:, 2].min(), min(spines) - BELOW), points[:, 2].max() + MARGIN
    rows = int(np.ceil((top - bottom) / pixel)) + 1
    return Window(pixel * np.arange(half, -half - 1, -1.0), top - pixel * np.arange(rows), pixel)


def relief(skin: Surface, landmarks: Landmarks, seen: Window) -> Relief:
    """Look at a skin from straight behind the pelvis.

    Args:
        skin: the skin [mm].
        landmarks: those that go with it [mm].
        seen: where to look.

    Raises:
        InputError: as `asis_axis`.
    """
    vertices = in_pelvis(skin.vertices, landmarks)
    face, weights = _first_hits(vertices, skin.faces, seen)
    beside = face < 0
    corners = skin.faces[face]
    depth = np.einsum("ijk,ijk->ij", weights, vertices[:, 1][corners])
    normal = np.einsum("ijk,ijkl->ijl", weights, vertex_normals(Surface(vertices, skin.faces))[corners])
    depth[beside], normal[beside] = np.nan, np.nan
    normal /= np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-12)
    centroids = np.array([landmarks.of_bone(level).points.mean(axis=0) for level in landmarks.vertebrae()])
    return Relief(depth, normal, in_pelvis(centroids.reshape(-1, 3), landmarks)[:, [0, 2]])


def side_difference(back: Relief, seen: Window) -> tuple[np.ndarray, np.ndarray]:
    """How far the back stands behind its other side, at the same height and as far from the spine.

    That is what back surface rotation measures too; here for every place instead of one line for a vertebra.
    The line of the spine joins the centroids of the vertebrae; above and below them nothing is compared.

    Returns:
        The difference of depth [mm], positive where a place stands further back, NaN where it has no other
        side, shape (rows, columns); and how much of a back it is there, from 0 (flank) to 1, same shape.
    """
    order = np.argsort(back.spine[:, 1])
    spine = np.interp(seen.z, back.spine[order, 1], back.spine[order, 0], left=np.nan, right=np.nan)
    column = (seen.x[0] - 2.0 * spine[:, None] + seen.x) / seen.pixel  # of the other side
    near = np.clip((WIDE - np.abs(seen.x - spine[:, None])) / (WIDE - NEAR), 0.0, 1.0)
    facing = near * np.clip((back.normal[:, :, 1] - FLANK) / (BACK - FLANK), 0.0, 1.0)
    difference = back.depth - _between_columns(back.depth, column)
    return difference, np.nan_to_num(np.minimum(facing, _between_columns(facing, column)))


def _first_hits(vertices: np.ndarray, faces: np.ndarray, seen: Window) -> tuple[np.ndarray, np.ndarray]:
    """The face seen in each pixel, -1 for none, and the weights of its corners (rows, columns, 3)."""
    import warp as wp

    from warp_trunk.geometry.search_tree import search_tree
    from warp_trunk.kernels.depth import first_hit

    near, far = vertices[:, 1].max() + 1.0, vertices[:, 1].min() - 1.0
    mesh, middle = search_tree(Surface(vertices, faces))
    shape = (len(seen.z), len(seen.x))
    face = wp.zeros(shape, dtype=wp.int32, device="cpu")
    weights = wp.zeros(shape, dtype=wp.vec3, device="cpu")
    right, down, forward = wp.vec3(-seen.pixel, 0.0, 0.0), wp.vec3(0.0, 0.0, -seen.pixel), wp.vec3(0.0, -1.0, 0.0)
    corner = wp.vec3(*(np.array([seen.x[0], near, seen.z[0]]) - middle))
    wp.launch(
        first_hit,
        dim=shape,
        inputs=[mesh.id, corner, right, down, forward, float(near - far)],
        outputs=[face, weights],
        device="cpu",
    )
    return face.numpy(), weights.numpy().astype(np.float64)


def _between_columns(values: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Values (rows, columns) at places between columns, linear; NaN outside. Same shape as `column`."""
    inside = (column >= 0.0) & (column <= values.shape[1] - 1)
    left = np.clip(np.nan_to_num(np.floor(column)).astype(int), 0, values.shape[1] - 2)
    part = column - left
    row = np.arange(len(values))[:, None]
    return np.where(inside, (1.0 - part) * values[row, left] + part * values[row, left + 1], np.nan)
