"""The skin of a body brought onto a scan: by smooth warps, and then to the points themselves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from warp_trunk.geometry.distance_field import nearest
from warp_trunk.geometry.spline import fit_spline, spread_centres
from warp_trunk.geometry.surface import Surface, vertex_areas, vertex_normals
from warp_trunk.geometry.surface_fit import place_matrix, solved, thin_plate

from .scan import BackScan

NUGGETS = (60.0, 30.0, 10.0)
"""How freely the skin follows the scan, warp by warp [mm]."""
REACH = (70.0, 30.0, 15.0)
"""Skin farther from the scan than this before a warp is not drawn to it [mm]."""
_FACING = 0.5
"""Skin is drawn to points whose normal is within 60 degrees of its own."""
_ASIDE = 8.0
"""A point farther beside the normal of the scan than this is beyond the rim [mm]."""
_APART = 18.0
"""Distance of the points of the skin that are drawn [mm]."""
_HELD = 1.0
"""Nugget of the points that stay [mm]."""


@dataclass(frozen=True)
class OnScan:
    """Where points of a skin lie on a scan."""

    seen: np.ndarray
    """Whether the scan goes on under the point, bool, shape (n,)."""
    distance: np.ndarray
    """From the plane of the nearest points of the scan along its normal, positive where that is outside [mm]."""
    goal: np.ndarray
    """The foot on that plane [mm], shape (n, 3)."""


class ScanField:
    """Looks up the scan near points of a skin."""

    def __init__(self, scan: BackScan) -> None:
        """Builds the search tree."""
        from scipy.spatial import KDTree  # heavy

        self.scan, self._tree = scan, KDTree(scan.points)

    def at(self, points: np.ndarray, normals: np.ndarray, reach: float) -> OnScan:
        """The scan at points (n, 3) with outward normals (n, 3), within reach [mm]."""
        _, near = self._tree.query(points)
        scan = self.scan
        to, facing = scan.points[near] - points, scan.normals[near]
        distance = np.einsum("ni,ni->n", to, facing)
        aside = np.linalg.norm(to - distance[:, None] * facing, axis=1)
        alike = np.einsum("ni,ni->n", normals, facing) > _FACING
        seen = alike & (np.abs(distance) < reach) & (aside < _ASIDE) & ~(scan.rim[near] & (aside > 4.0))
        return OnScan(seen, distance, points + distance[:, None] * facing)


def warp_onto(skin: Surface, field: ScanField, held: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """The map of some smooth warps, each towards the nearest points of the scan with a like normal.

    Args:
        skin: closed, near the scan.
        field: the scan.
        held: points that stay, shape (n, 3) [mm].
    """
    rows = spread_centres(skin.vertices, _APART)
    splines = []

    def carry(points: np.ndarray) -> np.ndarray:
        for spline in splines:
            points = spline(points)
        return points

    for nugget, reach in zip(NUGGETS, REACH, strict=True):
        now = Surface(carry(skin.vertices), skin.faces)
        on = field.at(now.vertices[rows], vertex_normals(now)[rows], reach)
        start, goal = now.vertices[rows][on.seen], on.goal[on.seen]
        nuggets = np.append(np.full(len(start), nugget), np.full(len(held), _HELD))
        splines.append(fit_spline(np.vstack([start, held]), np.vstack([goal, held]), nuggets, drift="constant"))
    return carry


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
    from scipy.sparse import diags_array  # heavy

    area = np.linalg.norm(vertex_areas(skin), axis=1)
    smooth = SMOOTHING**4 * thin_plate(skin) + (SMOOTHING / _FADES) ** 4 * diags_array(area)
    start = moved = skin.vertices
    for _ in range(_ROUNDS):
        face, weights = nearest(Surface(moved, skin.faces), scan.points, 2.0 * ON_TRUNK)
        used = face >= 0
        place = place_matrix(skin, face[used], weights[used])
        foot, normal = place @ moved, scan.normals[used]
        off = np.einsum("ni,ni->n", scan.points[used] - foot, normal)
        goal = foot + off[:, None] * normal - place @ start
        data = place.T @ diags_array(scan.areas[used])
        moved = start + solved(data @ place + smooth, data @ goal)
    return Surface(moved, skin.faces)


def seen_by(skin: Surface, scan: BackScan) -> np.ndarray:
    """Which vertices of the skin lie on the scan, bool, shape (vertices,)."""
    from scipy.spatial import KDTree  # heavy

    return np.asarray(KDTree(scan.points).query(skin.vertices)[0]) < _SEEN
