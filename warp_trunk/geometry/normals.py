"""Normals and areas of triangles and of the vertices between them."""

from __future__ import annotations

import numpy as np

from .surface import Surface


def area_vectors(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Outward normal of each triangle (faces, 3), of the length of its area [mm^2]; zero for one without area."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return 0.5 * np.cross(b - a, c - a)


def unit(vectors: np.ndarray) -> np.ndarray:
    """The vectors (n, 3) at length 1; one without length stays as it is."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1), 1e-300)[:, None]


def vertex_areas(surface: Surface) -> np.ndarray:
    """A third of the area vectors [mm^2] of the triangles around each vertex, shape (vertices, 3)."""
    third = np.repeat(area_vectors(surface.vertices, surface.faces) / 3.0, 3, axis=0)
    corner, count = surface.faces.reshape(-1), len(surface.vertices)
    return np.column_stack([np.bincount(corner, third[:, k], minlength=count) for k in range(3)])


def vertex_normals(surface: Surface) -> np.ndarray:
    """Unit normals of the vertices: the mean of the triangles at each, weighted by area, shape (vertices, 3)."""
    return unit(vertex_areas(surface))


def corner_areas(surface: Surface) -> np.ndarray:
    """The area of surface around each vertex, a third of its triangles [mm2], shape (vertices,)."""
    third = np.repeat(np.linalg.norm(area_vectors(surface.vertices, surface.faces), axis=1) / 3.0, 3)
    return np.bincount(surface.faces.reshape(-1), third, len(surface.vertices))
