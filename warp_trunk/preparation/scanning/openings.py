"""Where no scan has seen the skin: holes in it, and the open ends at neck, arms and thighs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from warp_trunk.geometry.normals import vertex_areas
from warp_trunk.geometry.surface import Surface, directed_edges
from warp_trunk.geometry.surface_checks import boundary_edges, linked_parts

from .parts import covers

_STEEP = 0.8
"""At an open end the skin at the rim leans on the plane through it by more than 37 degrees: its mean cosine."""
_UPRIGHT = 0.8
"""A plane whose normal is within 37 degrees of the z axis may be that of a neck or of the thighs."""
_BEYOND = 0.2
"""Beyond such an end the scan goes on by less than this part of the root of its area."""
_FLAT = 0.15
"""The rim of an end is within this part of the root of its area of a plane on average."""
_TO_RIM = 0.6
"""An opening is taken to where the scans are nearer than this part of the reach."""
_FITS = 8
"""How often the plane of a rim is fitted, each time to the points near the one before."""
_SMALLEST_END = 3000.0
"""Openings smaller than this [mm^2] are holes whatever their rim: a neck or an arm is larger."""


@dataclass(frozen=True)
class Opening:
    """A part of the closed surface that no scan has seen."""

    centre: np.ndarray
    """Middle of its rim [mm], shape (3,)."""
    normal: np.ndarray
    """Normal of the plane through its rim, outward, of length 1, shape (3,)."""
    area: float
    """Area of the lid over it [mm^2], without a margin of some 6 mm along the rim."""
    is_end: bool
    """Whether it is where the scan ends (neck, arm, thigh) and was closed flat, and not a hole in the skin."""


def rim_of(parts: Mapping[str, Surface], reaches: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """The vertices where a scan ends and no other goes on: positions (n, 3) [mm] and normals (n, 3)."""
    points, normals = [], []
    for name, part in parts.items():
        at_edge = np.unique(boundary_edges(part.faces))
        at, area = part.vertices[at_edge], vertex_areas(part)[at_edge]
        alone = covers(parts, reaches, name, at, area) == 0
        points.append(at[alone])
        normals.append(area[alone] / np.maximum(np.linalg.norm(area[alone], axis=1), 1e-12)[:, None])
    return np.concatenate(points), np.concatenate(normals)


def find_openings(
    lid: Surface, points: np.ndarray, rim: tuple[np.ndarray, np.ndarray], reach: float
) -> list[Opening]:
    """The openings of a scan, largest first.

    An opening is an end if its rim is flat, and either the skin at the rim stands steeply on the plane through
    it, as on the stump of an arm, or the scan ends there above or below; at a hole in the skin the lid goes on
    in the direction of the skin.

    Args:
        lid: the level set of the winding number, which spans each opening; closed.
        points: samples of the scans [mm], shape (n, 3), nearer to each other than the reach.
        rim: see rim_of.
        reach: what is farther than this from every point [mm] is open.
    """
    from scipy.spatial import KDTree  # heavy

    from_scans = np.asarray(KDTree(points).query(lid.vertices)[0])
    part = patches(lid, from_scans > _TO_RIM * reach)
    is_open = np.isin(part, part[from_scans > reach])  # to the rim, where it is open at all
    if not is_open.any():
        return []
    vertex_area = vertex_areas(lid)
    where = np.flatnonzero(is_open)
    distance, nearest = KDTree(lid.vertices[where]).query(rim[0])
    opening_of_rim = np.where(distance < reach, part[where[nearest]], -1)
    openings = []
    for number in np.unique(part[where]):
        members = is_open & (part == number)
        size = float(np.linalg.norm(vertex_area[members], axis=1).sum())
        at_rim = opening_of_rim == number
        centre = lid.vertices[members].mean(axis=0)
        normal = vertex_area[members].sum(axis=0)
        normal /= max(float(np.linalg.norm(normal)), 1e-12)
        is_end = False
        if at_rim.sum() >= 3:
            centre, normal, off = _plane_through(rim[0][at_rim], normal)
            flat = off < _FLAT * np.sqrt(size)
            steep = float((rim[1][at_rim] @ normal).mean()) < _STEEP
            beyond = float(((points - centre) @ normal).max())
            last = abs(normal[2]) > _UPRIGHT and beyond < _BEYOND * np.sqrt(size)
            is_end = flat and (steep or last) and size > _SMALLEST_END
        openings.append(Opening(centre, normal, size, bool(is_end)))
    return sorted(openings, key=lambda opening: -opening.area)


def _plane_through(points: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Centre and normal of the plane most points lie in, near the given normal, and their mean distance [mm].

    Points three times as far from it as most are left out: edges of scans that run away from the rim.
    """
    centre, off = np.median(points, axis=0), np.zeros(0)
    for _ in range(_FITS):
        off = np.abs((points - centre) @ normal)
        kept = off <= max(3.0 * float(np.median(off)), 0.5)
        centre = points[kept].mean(axis=0)
        axis = np.linalg.svd(points[kept] - centre, full_matrices=False)[2][2]
        normal = axis if axis @ normal > 0.0 else -axis
    return centre, normal, float(off.mean())


def patches(surface: Surface, chosen: np.ndarray) -> np.ndarray:
    """A number for each vertex, the same for two that are joined by edges between chosen ones (bool)."""
    first, second = directed_edges(surface.faces)
    joined = chosen[first] & chosen[second]
    return linked_parts(first[joined], second[joined], len(chosen))
