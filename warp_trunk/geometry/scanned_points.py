"""An open surface of points that were scanned from one side."""

from __future__ import annotations

import numpy as np

from warp_trunk.errors import InputError

from .surface import Surface

SPACING = 3.0
"""Points nearer than this are averaged [mm]."""
BUMP = (9.0, 1.5)
"""A bump is narrower than twice the first and stands out by more than the second [mm]."""
_STEEP = 1.0
"""Where the depth of the skin changes by more than this for each mm, no bump is looked for."""
_AROUND = 60
"""Points of skin that give the depth under a bump."""
GAP = 15.0
"""No triangle has a side longer than this, nor than four times the usual distance of points [mm]."""


def in_cubes(points: np.ndarray, size: float = SPACING) -> tuple[np.ndarray, np.ndarray]:
    """The means of points (n, 3) in cubes of a size [mm], shape (cubes, 3), and the cube of each point, (n,)."""
    _, cube, count = np.unique(
        np.floor(points / size).astype(np.int64), axis=0, return_inverse=True, return_counts=True
    )
    cube = cube.reshape(-1)
    return np.column_stack([np.bincount(cube, column) for column in points.T]) / count[:, None], cube


def without_bumps(points: np.ndarray, across: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points of a back without what sticks on it, and which have moved, (n, 3) [mm] and bool (n,).

    Markers, straps and strands of hair are narrower than a disc of radius `BUMP` and stand out by more than its
    height: a morphological opening of the depth seen from behind takes them away. Their points go to the depth of
    a quadratic through the skin around. A marker of 4 mm at the tangent's contact turns it by 2 degrees.

    Args:
        points: of a back [mm], shape (n, 3).
        across: unit vector to the left in the axial plane, shape (2,).
    """
    from scipy.ndimage import grey_dilation, grey_erosion  # heavy
    from scipy.spatial import KDTree

    radius, height = BUMP
    back = np.array([-across[1], across[0]])
    depth, seen = points[:, :2] @ back, np.column_stack([points[:, :2] @ across, points[:, 2]])
    place = np.round((seen - seen.min(axis=0)) / SPACING).astype(np.int64)
    if place.max() > 2000:
        return points, np.zeros(len(points), dtype=bool)  # no back in mm
    # where nothing is seen the depth is unlimited, so that the rim of a scan is no bump
    lowest = np.full(place.max(axis=0) + 1, np.inf)
    np.minimum.at(lowest, tuple(place.T), depth)
    ring = int(radius // SPACING)
    disc = np.hypot(*np.mgrid[-ring : ring + 1, -ring : ring + 1]) <= radius / SPACING
    padded = np.pad(lowest, ring, constant_values=np.inf)
    sunk = grey_erosion(padded, footprint=disc, mode="constant", cval=np.inf)
    sunk[np.isinf(sunk)] = -np.inf
    opened = grey_dilation(sunk, footprint=disc, mode="constant", cval=-np.inf)[ring:-ring, ring:-ring]
    out = np.isfinite(lowest) & (lowest > opened + height)
    likely = np.asarray(grey_dilation(out, size=3))[tuple(place.T)].astype(bool)
    moved, bump = points.copy(), np.zeros(len(points), dtype=bool)
    if likely.any() and (~likely).sum() > _AROUND:
        skin, level = seen[~likely], depth[~likely]
        near = KDTree(skin).query(seen[likely], k=_AROUND)[1]
        x, z = ((skin[near] - seen[likely][:, None]) / radius).transpose(2, 0, 1)
        terms = np.stack([np.ones_like(x), x, z, x * x, x * z, z * z], axis=2)
        around = (np.linalg.pinv(terms) @ level[near][:, :, None])[..., 0]
        below = depth[likely] - around[:, 0]
        slope = np.hypot(*around[:, 1:3].T) / radius
        # on a steep flank the noise of a place is noise of its depth
        bump[likely] = (below > height / 2.0 * np.hypot(1.0, slope)) & (slope < _STEEP)
        moved[bump, :2] -= below[bump[likely], None] * back
    return moved, bump


def surface_of_points(points: np.ndarray, across: np.ndarray) -> Surface:
    """Triangles between points that are neighbours seen from behind, counterclockwise seen from there.

    Args:
        points: of a back [mm], shape (n, 3), scanned from behind.
        across: unit vector to the left in the axial plane, shape (2,).

    Raises:
        InputError: points that form no surface.
    """
    from scipy.spatial import Delaunay, KDTree  # heavy

    seen = np.column_stack([points[:, :2] @ across, points[:, 2]])
    corners = Delaunay(seen).simplices
    usual = np.median(KDTree(points).query(points, k=2)[0][:, 1])
    side = np.linalg.norm(points[corners] - points[np.roll(corners, 1, axis=1)], axis=2).max(axis=1)
    corners = corners[side < max(GAP, 4.0 * usual)]
    if not len(corners):
        raise InputError(f"back: {len(points)} points form no surface; give the points of a scan in mm")
    (a, b), (c, d) = seen[corners[:, 1]].T - seen[corners[:, 0]].T, seen[corners[:, 2]].T - seen[corners[:, 0]].T
    corners[a * d - b * c > 0.0] = corners[a * d - b * c > 0.0][:, ::-1]  # from behind, left is on the left
    return Surface(points, corners.astype(np.int32))
