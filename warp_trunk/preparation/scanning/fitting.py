"""Draw a closed surface to measured points as smoothly as their noise asks for."""

from __future__ import annotations

import numpy as np

from warp_trunk.geometry.distance_field import nearest
from warp_trunk.geometry.normals import vertex_areas
from warp_trunk.geometry.surface import Surface, directed_edges

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
    from scipy.sparse import coo_array, csr_array, diags_array  # heavy
    from scipy.sparse.linalg import splu

    count = len(surface.vertices)
    size = np.linalg.norm(areas, axis=1)
    vertices = surface.vertices
    first, second = directed_edges(surface.faces)
    valence = np.bincount(first, minlength=count)
    for _ in range(_ROUNDS):
        now = Surface(vertices, surface.faces)
        face, weights = nearest(now, points, reach)
        vertex_area = vertex_areas(now)
        at_vertex = np.linalg.norm(vertex_area, axis=1)
        unit = vertex_area / np.maximum(at_vertex, 1e-12)[:, None]
        corners = surface.faces[face]
        normal = np.einsum("nk,nki->ni", weights, unit[corners])
        used = (face >= 0) & (np.einsum("ni,ni->n", normal, areas) > _FACING * size)
        corners, weights, normal = corners[used], weights[used], normal[used]
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        foot = np.einsum("nk,nki->ni", weights, vertices[corners])
        target = foot + np.einsum("ni,ni->n", points[used] - foot, normal)[:, None] * normal
        start = np.arange(0, corners.size + 1, 3)
        place = csr_array((weights.reshape(-1), corners.reshape(-1), start), shape=(len(corners), count))
        data = place.T @ diags_array(size[used])
        step = vertices[second] - vertices[first]
        square = np.bincount(first, np.einsum("ei,ei->e", step, step), minlength=count) / valence
        # the mean of the neighbours less the vertex is a quarter of the squared edge length times the Laplacian
        scale = 4.0 * np.sqrt(at_vertex) / square
        mean = coo_array((scale[first] / valence[first], (first, second)), shape=(count, count)).tocsr()
        laplacian = mean - diags_array(scale)
        hold = _HOLD * diags_array(at_vertex)
        system = (data @ place + smoothing**4 * (laplacian.T @ laplacian) + hold).tocsc()
        solve = splu(system, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        vertices = solve.solve(data @ target + hold @ vertices)
    return Surface(vertices, surface.faces)
