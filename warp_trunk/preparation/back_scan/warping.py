"""Smooth warps that bring the skin of a body onto a scan, and what lies under it along."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from warp_trunk.geometry.normals import vertex_normals
from warp_trunk.geometry.spline import fit_spline, spread_centres
from warp_trunk.geometry.surface import Surface

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


def warp_onto(
    skin: Surface, field: ScanField, held: np.ndarray, chosen: np.ndarray | None = None
) -> Callable[[np.ndarray], np.ndarray]:
    """The map of some smooth warps, each towards the nearest points of the scan with a like normal.

    Args:
        skin: closed, near the scan.
        field: the scan.
        held: points that stay, shape (n, 3) [mm].
        chosen: vertices of the skin that may be drawn; spread over all of it when left out.
    """
    rows = spread_centres(skin.vertices, _APART) if chosen is None else chosen
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
