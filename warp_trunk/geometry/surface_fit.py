"""Draw a closed surface to measured points as smoothly as their noise asks for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .distance_field import nearest
from .surface import (
    Surface,
    directed_edges,
    neighbour_means,
    unit,
    vertex_areas,
    vertex_normals,
)

if TYPE_CHECKING:
    from scipy.sparse import csr_array

_FACING = 0.5
"""Points whose normal is turned further than 60 degrees from the surface's belong to another fold of it."""
_ROUNDS = 3
"""How often the nearest places on the surface are searched."""
_HOLD = 1e-6
"""Keeps the system regular where there are no points; of the weight of a fully covered vertex."""


def fit_to_points(
    surface: Surface, points: np.ndarray, areas: np.ndarray, smoothing: float, reach: float
) -> Surface:
    """Move the vertices of a closed surface to the smoothing spline of points measured on it.

    Least squares of the distances of the points from the surface along its normals, weighted by area, plus
    smoothing^4 times the integral of the squared Laplacian of position (thin plate). Details of a
    wavelength of 2 pi smoothing keep half their height, those of twice that length 94 %, so what is shorter is
    averaged; where there are no points the plate goes on from the rim with its curvature.

    Args:
        surface: near the points; its triangles stay.
        points: measured [mm], shape (n, 3).
        areas: area of skin each point stands for times its outward normal [mm^2], shape (n, 3).
        smoothing: [mm], 0 or more.
        reach: points farther from the surface than this [mm] are left out.
    """
    from scipy.sparse import diags_array  # heavy

    size, vertices = np.linalg.norm(areas, axis=1), surface.vertices
    for _ in range(_ROUNDS):
        now = Surface(vertices, surface.faces)
        face, weights = nearest(now, points, reach)
        normal = np.einsum("nk,nki->ni", weights, vertex_normals(now)[surface.faces[face]])
        used = (face >= 0) & (np.einsum("ni,ni->n", normal, areas) > _FACING * size)
        normal, place = unit(normal[used]), place_matrix(surface, face[used], weights[used])
        foot = place @ vertices
        target = foot + np.einsum("ni,ni->n", points[used] - foot, normal)[:, None] * normal
        data = place.T @ diags_array(size[used])
        hold = _HOLD * diags_array(np.linalg.norm(vertex_areas(now), axis=1))
        plate = smoothing**4 * thin_plate(now)
        vertices = solved(data @ place + plate + hold, data @ target + hold @ vertices)
    return Surface(vertices, surface.faces)


def thin_plate(surface: Surface) -> csr_array:
    """The matrix B of the bending of a plate: x.B x is the integral of the squared Laplacian of values x at the
    vertices of a closed surface, shape (vertices, vertices)."""
    from scipy.sparse import diags_array  # heavy

    first, second = directed_edges(surface.faces)
    step = surface.vertices[second] - surface.vertices[first]
    square = np.bincount(first, np.einsum("ei,ei->e", step, step)) / np.bincount(first)
    # the mean of the neighbours less the vertex is a quarter of the squared edge length times the Laplacian
    scale = 4.0 * np.sqrt(np.linalg.norm(vertex_areas(surface), axis=1)) / square
    laplacian = diags_array(scale) @ neighbour_means(surface) - diags_array(scale)
    return (laplacian.T @ laplacian).tocsr()


def place_matrix(surface: Surface, face: np.ndarray, weights: np.ndarray) -> csr_array:
    """The matrix that takes values at vertices to places in triangles (n,) by their corners' weights (n, 3)."""
    from scipy.sparse import csr_array  # heavy

    corners = surface.faces[face]
    start = np.arange(0, corners.size + 1, 3)
    shape = len(corners), len(surface.vertices)
    return csr_array((weights.reshape(-1), corners.reshape(-1), start), shape=shape)


def solved(matrix: csr_array, right: np.ndarray) -> np.ndarray:
    """The solution of a sparse symmetric positive definite system for right sides (n, k), shape (n, k)."""
    from scipy.sparse.linalg import splu  # heavy

    ordered = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    return splu(matrix.tocsc(), **ordered).solve(right)
