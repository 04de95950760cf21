"""One skin of both: the scan where there is one, the body elsewhere, without a step between them."""

from __future__ import annotations

import numpy as np

from warp_trunk.geometry.distance_field import nearest
from warp_trunk.geometry.normals import vertex_areas, vertex_normals
from warp_trunk.geometry.surface import Surface, directed_edges

from .scan import BackScan

SMOOTHING = 4.0
"""Details of the scan shorter than about six times this are taken for noise [mm]."""
_FADES = 40.0
"""Over about this length the skin of the body takes up what is left between it and the scan at its rim [mm]."""
ON_TRUNK = 10.0
"""Points of the scan farther than this from the warped body are not of the trunk: arms, hair, clothes [mm]."""
_SEEN = 6.0
"""Skin within this distance of a point of the scan is measured [mm]."""
_ROUNDS = 3


def on_trunk(skin: Surface, scan: BackScan) -> np.ndarray:
    """Which points of a scan lie on the trunk, bool, shape (n,): near the skin, with a like normal."""
    face, weights = nearest(skin, scan.points, ON_TRUNK)
    normal = np.einsum("nk,nki->ni", weights, vertex_normals(skin)[skin.faces[face]])
    return (face >= 0) & (np.einsum("ni,ni->n", normal, scan.normals) > 0.5)


def draw_to_scan(skin: Surface, scan: BackScan) -> Surface:
    """The skin moved onto the points of the scan.

    The displacement is the smoothest one, least squares of the distances of the points along their normals,
    weighted by area, plus `SMOOTHING`^4 times the integral of its squared Laplacian; away from the points it fades
    over `_FADES`. So the shape of the body goes on where the scan ends, and there is no step.

    Args:
        skin: closed, near the points; its triangles stay.
        scan: the points of the trunk.
    """
    from scipy.sparse import coo_array, csr_array, diags_array  # heavy
    from scipy.sparse.linalg import splu

    count, start = len(skin.vertices), skin.vertices
    first, second = directed_edges(skin.faces)
    valence = np.bincount(first, minlength=count)
    area = np.linalg.norm(vertex_areas(skin), axis=1)
    step = start[second] - start[first]
    square = np.bincount(first, np.einsum("ei,ei->e", step, step), minlength=count) / valence
    # the mean of the neighbours less the vertex is a quarter of the squared edge length times the Laplacian
    scale = 4.0 * np.sqrt(area) / square
    mean = coo_array((scale[first] / valence[first], (first, second)), shape=(count, count)).tocsr()
    laplacian = mean - diags_array(scale)
    smooth = SMOOTHING**4 * (laplacian.T @ laplacian) + (SMOOTHING / _FADES) ** 4 * diags_array(area)
    moved = start
    for _ in range(_ROUNDS):
        face, weights = nearest(Surface(moved, skin.faces), scan.points, 2.0 * ON_TRUNK)
        used = face >= 0
        corners, at, weight = skin.faces[face[used]], weights[used], scan.areas[used]
        rows = np.arange(0, corners.size + 1, 3)
        place = csr_array((at.reshape(-1), corners.reshape(-1), rows), shape=(len(corners), count))
        foot, normal = place @ moved, scan.normals[used]
        off = np.einsum("ni,ni->n", scan.points[used] - foot, normal)
        goal = foot + off[:, None] * normal - place @ start
        data = place.T @ diags_array(weight)
        solve = splu(
            (data @ place + smooth).tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        moved = start + solve.solve(data @ goal)
    return Surface(moved, skin.faces)


def seen_by(skin: Surface, scan: BackScan) -> np.ndarray:
    """Which vertices of the skin lie on the scan, bool, shape (vertices,)."""
    from scipy.spatial import KDTree  # heavy

    return np.asarray(KDTree(scan.points).query(skin.vertices)[0]) < _SEEN
