"""Small closed surfaces and meshes for tests."""

from __future__ import annotations

import numpy as np

from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.geometry.surface import Surface
from warp_trunk.meshing import MeshOptions, build_trunk


def sphere(radius: float, centre: tuple[float, float, float] = (0.0, 0.0, 0.0), subdivisions: int = 3) -> Surface:
    """A sphere of nearly equal triangles, 20 * 4**subdivisions of them, oriented outward."""
    ratio = (1.0 + 5.0**0.5) / 2.0
    corners = [(0.0, a, b * ratio) for a in (-1.0, 1.0) for b in (-1.0, 1.0)]
    points = np.array([np.roll(corner, shift) for shift in range(3) for corner in corners])
    near = np.linalg.norm(points[:, None] - points[None], axis=2) < 2.1
    faces = np.array(
        [
            (i, j, k)
            for i in range(12)
            for j in range(i + 1, 12)
            for k in range(j + 1, 12)
            if near[i, j] and near[j, k] and near[i, k]
        ]
    )
    inward = np.einsum("fi,fi->f", points[faces[:, 0]], np.cross(points[faces[:, 1]], points[faces[:, 2]])) < 0
    faces[inward] = faces[inward][:, ::-1]
    for _ in range(subdivisions):
        points, faces = _split(points, faces)
        points /= np.linalg.norm(points, axis=1)[:, None]
    points = points / np.linalg.norm(points, axis=1)[:, None]
    return Surface(radius * points + np.array(centre), faces.astype(np.int32))


def box(
    size: tuple[float, float, float], centre: tuple[float, float, float] = (0.0, 0.0, 0.0), splits: int = 0
) -> Surface:
    """A box; each split makes four triangles of one."""
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    points = corners
    for _ in range(splits):
        points, faces = _split(points, faces)
    return Surface(points * np.array(size) + np.array(centre), faces.astype(np.int32))


def shell_trunk(tets: int = 3000) -> TrunkMesh:
    """Soft tissue between a sphere of 100 mm radius and two bones inside it that touch, not cached."""
    bones = {
        "upper": sphere(25.0, (0.0, 5.0, 22.0), 2),
        "lower": sphere(25.0, (0.0, 5.0, -22.0), 2),
    }
    return build_trunk(sphere(100.0), bones, MeshOptions(tets=tets, bone_voxel=6.0, cache=False))


def _split(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, number = np.unique(edges, axis=0, return_inverse=True)
    ab, bc, ca = len(points) + number.reshape(3, -1)
    a, b, c = faces.T
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([points, points[unique].mean(axis=1)]), np.concatenate([np.stack(p, 1) for p in parts])
