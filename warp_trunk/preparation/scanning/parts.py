"""Scans of one trunk: whether they fit together, which places several have seen, and how they are aligned.

Our own, as point-to-point ICP of the libraries left 2 to 3 mm on skin as smooth as a back; distances along
normals, of all pairs of scans at once, leave 0.1 to 0.5 mm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import nearest
from warp_trunk.geometry.rigid import RigidMotion
from warp_trunk.geometry.surface import Surface, area_vectors, check_surface, side_lengths, unit, vertex_areas
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
    gap = np.array([[tree.query(other.data)[0].min() for other in trees] for tree in trees])
    row, column = np.nonzero(gap <= _WIDEST_GAP)
    group = linked_parts(row, column, len(parts))
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
    covered = [covered_by(points, normals, parts[other], reaches[other]) for other in parts if other != name]
    return np.sum(covered, axis=0) if covered else np.zeros(len(points))


def reach_of(surface: Surface, noise: float) -> float:
    """How far a vertex may be from a point on the same place [mm]: the longest usual edge, and the noise."""
    return float(np.percentile(side_lengths(surface), 90.0)) + noise


_ROUNDS = 30
"""How often the nearest places are searched at most."""
_STILL = 0.01
"""Scans that move less than this in a round [mm] have arrived."""
_FAR = 10.0
"""Scans may be this far from where they belong [mm]."""
_FEWEST_COMMON = 50
"""Fewer points in common than this say nothing about a rotation."""


@dataclass(frozen=True)
class Alignment:
    """The motion of a scan."""

    matrix: np.ndarray
    """Rigid transform that was applied, shape (4, 4)."""
    shift: float
    """How far it moved the middle of the scan [mm]."""
    turn: float
    """Angle of its rotation [degrees]."""
    distance: float
    """Root mean square distance from the other scans where they overlap, along their normals, afterwards [mm]."""


def align_parts(parts: Mapping[str, Surface]) -> tuple[dict[str, Surface], dict[str, Alignment]]:
    """Move all scans but the first rigidly, so that they lie on each other where they overlap.

    Iterative closest points with distances along the normals of the other scan (Chen and Medioni 1992), all pairs
    of scans in one least squares problem, so that the error around the trunk is shared and none is left where
    the last meets the first. (Moving point to point, one scan after the other, stalls on skin this smooth.)

    Args:
        parts: scans within some 10 mm of where they belong, by name.

    Returns the scans moved, and by what each was moved.

    Raises InputError when a scan overlaps no other.
    """
    names = list(parts)
    now = dict(parts)
    total = dict.fromkeys(names, RigidMotion.identity())
    reaches = {name: reach_of(part, _FAR) for name, part in parts.items()}
    middle = np.concatenate([part.vertices for part in parts.values()]).mean(axis=0)
    size = max(float(np.ptp(part.vertices, axis=0).max()) for part in parts.values())
    square, count = np.zeros(len(names)), np.zeros(len(names))
    for _ in range(_ROUNDS):
        system, right = np.zeros((6 * len(names),) * 2), np.zeros(6 * len(names))
        square[:], count[:] = 0.0, 0.0
        for i, j in permutations(range(len(names)), 2):
            points, normal, off = _distances(now[names[i]], now[names[j]], reaches[names[j]])
            square[[i, j]] += off @ off
            count[[i, j]] += len(off)
            # turning by w about the middle and shifting by s moves a point along n by (p x n).w + n.s
            row = np.zeros((len(off), len(names), 6))
            row[:, i] = np.column_stack([np.cross(points - middle, normal) / size, normal])
            row[:, j] = -row[:, i]
            row = row.reshape(-1, right.size)
            system += row.T @ row
            right -= row.T @ off
        least = count.argmin()
        if count[least] < _FEWEST_COMMON:
            reach = f"{count[least]:.0f} vertices, and needs {_FEWEST_COMMON} to be refined"
            raise InputError(f"{names[least]}: overlaps the other parts in {reach}; give scans that overlap more")
        motions = np.zeros((len(names), 6))  # the first one stays
        motions[1:] = np.linalg.lstsq(system[6:, 6:], right[6:], rcond=1e-9)[0].reshape(-1, 6)
        for name, motion in zip(names[1:], motions[1:], strict=True):
            turn = RigidMotion.exp(np.append(motion[:3] / size, np.zeros(3))).rotation
            step = RigidMotion.about(turn, middle, middle + motion[3:])
            now[name] = moved(now[name], step.as_matrix())
            total[name] = step * total[name]
        if np.abs(motions).max() < _STILL:
            break
    alignments = {}
    for name, distance in [*zip(names, np.sqrt(square / count), strict=True)][1:]:
        middle, motion = parts[name].vertices.mean(axis=0), total[name]
        shift = float(np.linalg.norm(motion.apply(middle) - middle))
        turn = float(np.degrees(motion.angle))
        alignments[name] = Alignment(motion.as_matrix(), shift, turn, float(distance))
    return now, alignments


def _distances(part: Surface, other: Surface, reach: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices of a scan that lie on the other (n, 3), normals there (n, 3), distances along these (n,) [mm]."""
    normals = vertex_areas(other)
    on_other = covered_by(part.vertices, vertex_areas(part), other, reach)
    points = part.vertices[on_other]
    face, weights = nearest(other, points, reach)
    points, face, weights = points[face >= 0], face[face >= 0], weights[face >= 0]
    normal = unit(np.einsum("nk,nki->ni", weights, normals[other.faces[face]]))
    foot = np.einsum("nk,nki->ni", weights, other.vertices[other.faces[face]])
    return points, normal, np.einsum("ni,ni->n", points - foot, normal)


def moved(surface: Surface, matrix: np.ndarray) -> Surface:
    """The surface carried by a rigid transform (4, 4)."""
    return surface.moved(surface.vertices @ matrix[:3, :3].T + matrix[:3, 3])
