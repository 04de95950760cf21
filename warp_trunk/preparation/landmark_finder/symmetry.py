"""The plane in which a bone is most nearly its own mirror image."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from warp_trunk.geometry.surface import Surface

_SAMPLES, _COARSE, _FINE = 3000, 200, 1000
"""Points on the bone: those that are looked up, and those that are mirrored in the search and in the fit."""
_NORMAL_WEIGHT = 5.0
"""Normals that are opposite count as far apart as points at twice this distance [mm]: the two walls of a thin
lamina are not taken for each other."""
_SMOOTHED = 8
"""Normals are averaged over this many points, so that the steps of voxels do not count."""
_OUTLIER = 1.0
"""Distances beyond this count less and less [mm]: a bent spinous process does not turn the plane."""
_CAP = 5.0
"""Distances count no further than this in the search [mm]."""
_TURNS = np.arange(-60.0, 61.0, 15.0)
"""Where the plane is looked for: turned about the bone's axis ..."""
_LEANS = np.array([-15.0, 0.0, 15.0])
"""... and leaning sideways [deg]."""
_STARTS = 3
"""As many of the best of these are followed."""


@dataclass(frozen=True, eq=False)
class SymmetryPlane:
    """Plane normal . x = offset."""

    normal: np.ndarray
    """Unit vector, to the bone's left, shape (3,)."""
    offset: float
    """[mm]"""
    residual: float
    """Median distance of the mirrored bone from itself [mm]."""


def symmetry_plane(surface: Surface, left: np.ndarray, up: np.ndarray) -> SymmetryPlane:
    """The plane nearest to `left` in which the bone differs least from its mirror image.

    A coarse search over directions, then least squares of the distances of mirrored points along the normals
    where they arrive, with a loss that hardly sees outliers. Points are spread evenly over the area, so that
    how the bone is meshed does not matter.

    Args:
        surface: a bone.
        left: unit vector within 60 degrees of the bone's left seen along `up`, shape (3,).
        up: unit vector along the bone, shape (3,).
    """
    points, normals = spread_points(surface, _SAMPLES)
    middle = points.mean(axis=0)
    left = left - (left @ up) * up
    left /= np.linalg.norm(left)
    axes = np.stack([left, np.cross(up, left), up])
    distances = _mirror_distances((points - middle) @ axes.T, normals @ axes.T)
    grid = [np.array([*np.radians([turn, lean]), 0.0]) for turn in _TURNS for lean in _LEANS]
    grid.sort(key=lambda plane: np.minimum(np.abs(distances(plane, _COARSE)), _CAP).mean())
    fits = [_fitted(distances, plane, _COARSE) for plane in grid[:_STARTS]]
    start = min(fits, key=lambda plane: np.minimum(np.abs(distances(plane, _FINE)), _CAP).mean())
    best = _fitted(distances, start, _FINE)
    normal = _direction(best) @ axes
    return SymmetryPlane(
        normal=normal,
        offset=float(normal @ middle + best[2]),
        residual=float(np.median(np.abs(distances(best, _SAMPLES)))),
    )


_Distances = Callable[[np.ndarray, int], np.ndarray]


def _mirror_distances(points: np.ndarray, normals: np.ndarray) -> _Distances:
    """Distances of mirrored points from the surface, of a plane (two angles [rad], offset [mm]) and a count."""
    from scipy.spatial import KDTree  # heavy

    _, near = KDTree(np.hstack([points, _NORMAL_WEIGHT * normals])).query(
        np.hstack([points, _NORMAL_WEIGHT * normals]), k=_SMOOTHED
    )
    normals = normals[near].mean(axis=1)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    tree = KDTree(np.hstack([points, _NORMAL_WEIGHT * normals]))

    def distances(plane: np.ndarray, count: int) -> np.ndarray:
        n = _direction(plane)
        mirrored = points[:count] - 2.0 * (points[:count] @ n - plane[2])[:, None] * n
        facing = normals[:count] - 2.0 * (normals[:count] @ n)[:, None] * n
        nearest = tree.query(np.hstack([mirrored, _NORMAL_WEIGHT * facing]))[1]
        return np.einsum("ij,ij->i", mirrored - points[nearest], normals[nearest])

    return distances


def _fitted(distances: _Distances, start: np.ndarray, count: int) -> np.ndarray:
    from scipy.optimize import least_squares  # heavy

    return least_squares(
        distances, start, args=(count,), loss="soft_l1", f_scale=_OUTLIER, x_scale=[0.05, 0.05, 1.0],
        diff_step=1e-3, xtol=1e-5, ftol=1e-6,
    ).x  # fmt: skip


def spread_points(surface: Surface, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points spread evenly over a surface's area and the unit normals there, each (count, 3), always the same."""
    a, b, c = np.moveaxis(surface.vertices[surface.faces], 1, 0)
    cross = np.cross(b - a, c - a)
    area = np.linalg.norm(cross, axis=1)
    rng = np.random.default_rng(0)
    # one point in each of `count` equal shares of the area, in an order that has nothing to do with place
    shares = rng.permutation(count) + rng.random(count)
    face = np.searchsorted(np.cumsum(area), shares * area.sum() / count).clip(max=len(area) - 1)
    u, v = rng.random((2, count))
    over = u + v > 1.0
    u, v = np.where(over, 1.0 - u, u)[:, None], np.where(over, 1.0 - v, v)[:, None]
    points = a[face] + u * (b - a)[face] + v * (c - a)[face]
    return points, cross[face] / np.maximum(area[face], 1e-300)[:, None]


def _direction(plane: np.ndarray) -> np.ndarray:
    """Unit vector near the first axis, turned about the third and lifted towards it by two angles [rad]."""
    turn, lean = plane[:2]
    return np.array([np.cos(lean) * np.cos(turn), np.cos(lean) * np.sin(turn), np.sin(lean)])
