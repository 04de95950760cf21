"""Scans of one trunk: whether they fit together, and which places several of them have seen."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.normals import area_vectors, vertex_areas
from warp_trunk.geometry.surface import Surface, check_surface
from warp_trunk.geometry.surface_checks import boundary_edges, linked_parts, turning_fault

_SMALLEST, _LARGEST = 150.0, 2500.0
"""The largest extent of a trunk is between these [mm]."""
_WIDEST_GAP = 30.0
"""A part farther than this from all others [mm] is not in their frame."""
_FACING = 0.5
"""Sheets whose normals differ by more than 60 degrees do not cover each other."""


def check_parts(parts: Mapping[str, Surface]) -> None:
    """Check the scans of one trunk.

    Raises InputError when there are none; when one is empty, not finite, or its triangles turn both ways;
    when all together are too small or too large for a trunk in mm; when one faces inward; or when one is far
    from the others.
    """
    from scipy.spatial import KDTree  # heavy

    if not parts:
        raise InputError("parts: there are none; give at least one surface")
    for name, part in parts.items():
        check_surface(part, name)
        if fault := turning_fault(part):
            raise InputError(f"{name}: {fault}; repair the surface")
    points = np.concatenate([part.vertices for part in parts.values()])
    extent = float(np.ptp(points, axis=0).max())
    if not _SMALLEST <= extent <= _LARGEST:
        rule = f"the parts together extend over {extent:.4g} mm, a trunk over {_SMALLEST:g} to {_LARGEST:g} mm"
        raise InputError(f"{next(iter(parts))}: {rule}; give them in mm")
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    for name, part in parts.items():
        outward = np.einsum(
            "fi,fi->", (part.vertices - middle)[part.faces].sum(axis=1), area_vectors(part.vertices, part.faces)
        )
        if outward <= 0.0:
            raise InputError(f"{name}: its triangles face into the trunk; turn them round (flip the normals)")
    trees = [KDTree(part.vertices) for part in parts.values()]
    gap = np.array([[one.query(other.data)[0].min() for other in trees] for one in trees])
    one, other = np.nonzero(gap <= _WIDEST_GAP)
    group = linked_parts(one, other, len(parts))
    for name, row, number in zip(parts, gap, group, strict=True):
        if number != group[0]:
            rule = f"is {row[group != number].min():.1f} mm from the other parts, and may be {_WIDEST_GAP:g} mm"
            raise InputError(f"{name}: {rule}; give its transform into their frame, or the part between")


def covered_by(points: np.ndarray, normals: np.ndarray, other: Surface, reach: float) -> np.ndarray:
    """Which points lie on another scan: its nearest vertex is near, faces the same way and is not on its edge.

    Args:
        points: positions [mm], shape (n, 3).
        normals: outward, of any length, shape (n, 3).
        other: the other scan.
        reach: how far its nearest vertex may be [mm].
    """
    from scipy.spatial import KDTree  # heavy

    distance, nearest = KDTree(other.vertices).query(points, distance_upper_bound=reach)
    near = np.flatnonzero(np.isfinite(distance))
    vertex = np.asarray(nearest)[near]
    area = vertex_areas(other)[vertex]
    size = np.linalg.norm(area, axis=1) * np.linalg.norm(normals[near], axis=1)
    same = np.einsum("ni,ni->n", area, normals[near]) > _FACING * size
    covered = np.zeros(len(points), dtype=bool)
    covered[near] = same & ~np.isin(vertex, boundary_edges(other.faces))
    return covered


def covers(
    parts: Mapping[str, Surface], reaches: Mapping[str, float], name: str, points: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """How many scans but the one called `name` cover each of some points (`covered_by`), shape (n,)."""
    others = [covered_by(points, normals, parts[other], reaches[other]) for other in parts if other != name]
    return np.sum(others, axis=0) if others else np.zeros(len(points))


def reach_of(surface: Surface, noise: float) -> float:
    """How far a vertex may be from a point on the same place [mm]: the longest usual edge, and the noise."""
    corners = surface.vertices[surface.faces]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    return float(np.percentile(edges, 90.0)) + noise
