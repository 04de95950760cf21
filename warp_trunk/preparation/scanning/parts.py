"""Scans of one trunk: whether they fit together, and which places several of them have seen."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.normals import vertex_areas
from warp_trunk.geometry.surface import Surface, check_surface

_SMALLEST, _LARGEST = 150.0, 2500.0
"""The largest extent of a trunk is between these [mm]."""
_WIDEST_GAP = 30.0
"""A part farther than this from all others [mm] is not in their frame."""


def check_parts(parts: Mapping[str, Surface]) -> None:
    """Check the scans of one trunk.

    Raises InputError when there are none; when one is empty, not finite, or its triangles turn both ways;
    when all together are too small or too large for a trunk in mm; when one faces inward; or when one is far
    from the others.
    """
    if not parts:
        raise InputError("parts: there are none; give at least one surface")
    for name, part in parts.items():
        check_surface(part, name)
        _check_turning(part, name)
    points = np.concatenate([part.vertices for part in parts.values()])
    extent = float(np.ptp(points, axis=0).max())
    if not _SMALLEST <= extent <= _LARGEST:
        raise InputError(
            f"{next(iter(parts))}: the parts together extend over {extent:.4g} mm, a trunk over {_SMALLEST:g} to "
            f"{_LARGEST:g} mm; give them in mm"
        )
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    for name, part in parts.items():
        a, b, c = np.moveaxis((part.vertices - middle)[part.faces], 1, 0)
        normal = np.cross(b - a, c - a)
        outward = float(np.einsum("fi,fi->", a + b + c, normal))
        if outward <= 0.0:
            raise InputError(f"{name}: its triangles face into the trunk; turn them round (flip the normals)")
    if len(parts) > 1:
        _check_together(parts)


def _check_turning(part: Surface, name: str) -> None:
    faces = part.faces.astype(np.int64)
    directed = np.sort((faces * len(part.vertices) + np.roll(faces, -1, axis=1)).reshape(-1))
    twice = directed[1:][directed[1:] == directed[:-1]]
    if twice.size:
        ends = part.vertices[[twice[0] // len(part.vertices), twice[0] % len(part.vertices)]]
        place = "({:.1f}, {:.1f}, {:.1f}) mm".format(*ends.mean(axis=0))
        raise InputError(
            f"{name}: neighbouring triangles turn opposite ways, or more than two share an edge, at {twice.size} "
            f"edges, the first near {place}; repair the surface"
        )


def _check_together(parts: Mapping[str, Surface]) -> None:
    """Every part must be reached from the first by steps from part to part no wider than a gap may be."""
    from scipy.spatial import KDTree  # heavy

    first, *left = parts
    trees = {name: KDTree(part.vertices) for name, part in parts.items()}
    reached = KDTree(parts[first].vertices)
    while left:
        gaps = {}
        for name in left:
            distance, _ = reached.query(parts[name].vertices)
            gaps[name] = (float(distance.min()), parts[name].vertices[int(distance.argmin())])
        name = min(gaps, key=lambda n: gaps[n][0])
        gap, at = gaps[name]
        if gap > _WIDEST_GAP:
            place = "({:.1f}, {:.1f}, {:.1f}) mm".format(*at)
            raise InputError(
                f"{name}: is {gap:.1f} mm from the other parts where it is nearest, at {place}, and may be "
                f"{_WIDEST_GAP:g} mm; give its transform into their frame, or the part between"
            )
        left.remove(name)
        reached = KDTree(np.concatenate([reached.data, trees[name].data]))


_FACING = 0.5
"""Sheets whose normals differ by more than 60 degrees do not cover each other."""


def boundary_vertices(surface: Surface) -> np.ndarray:
    """Which vertices lie on an edge of one triangle only, shape (vertices,), bool."""
    ends = np.concatenate([surface.faces[:, [0, 1]], surface.faces[:, [1, 2]], surface.faces[:, [2, 0]]])
    ends = np.sort(ends, axis=1)
    edges, count = np.unique(ends, axis=0, return_counts=True)
    on_boundary = np.zeros(len(surface.vertices), dtype=bool)
    on_boundary[edges[count == 1]] = True
    return on_boundary


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
    covered[near] = same & ~boundary_vertices(other)[vertex]
    return covered


def reach_of(surface: Surface, noise: float) -> float:
    """How far a vertex may be from a point on the same place [mm]: the longest usual edge, and the noise."""
    corners = surface.vertices[surface.faces]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    return float(np.percentile(edges, 90.0)) + noise
