"""The skin of a back among the points of a scan: what surrounds it, what stands on it, and the scan's noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warp_trunk.errors import InputError

from .raised import depth_grid, find_raised
from .scanned_points import SPACING, in_cubes, without_bumps
from .surface import Surface, area_vectors

WINDOW = 450.0
"""Points farther than this from the line of the spine, sideways and in depth, are not of the trunk [mm]."""
CORRIDOR = 50.0
"""The back is what lies first behind the line of the spine, within this distance to its sides [mm] ..."""
LAYER = (-40.0, 180.0)
"""... from this far to this far behind it, as it lies on the skin or in the bodies of the vertebrae [mm]."""
LINK = 10.0
"""Points in neighbouring cubes of this size hang together, or of three times their usual distance [mm]."""
NOISY = 0.8
"""Points that scatter by more than this about the skin are smoothed [mm]; those of scanners scatter by 0.05 to
0.5, of apps by 2 to 5."""
FEWEST_SEEN = 100
"""Points that a back needs."""
MOST_STRAY = 0.01
"""Surroundings are no more than this part of a scan that shows the back alone."""
_BESIDE = 250.0
"""A trunk does not reach farther than this beside its spine [mm]; a plane that does is a wall, table or floor."""
_ON_PLANE = 4.0
"""Points nearer than this to a plane are of it [mm] ..."""
_PLANE = 500
"""... which it takes as many cubes of 10 mm to fill."""
_HIDDEN = 40.0
"""Points farther than this in front of others are hidden by them, seen from behind [mm]."""
_LOOSE = 3.0
"""The sixth neighbour of a loose point is farther than this many times the usual distance."""
_POINT_AREA = 6.0
"""Area of a surface for each point on it [mm^2]."""
TALLER = 2.5
"""A noisy back is smoothed over this many times as far upwards as sideways: it changes less along the spine."""
EDGES, SMOOTHER = (4.0, 2.7), 2.0
"""A noisy back is smoothed over the sum of a length and so many times its noise [mm] to the sides to find what
stands on it, and over more by a factor for its skin."""
_SAMPLE = 1500
"""Points from which noise and usual distances are taken."""
_NEAR = 24
"""Neighbours through which a quadratic gives the noise of a point."""


@dataclass(frozen=True, eq=False)
class BackPoints:
    """The skin of a back in a scan, and what else the scan holds, in the frame of the scan."""

    skin: np.ndarray
    """Points of the skin [mm], averaged in cubes of `SPACING`, or smoothed if the scan is noisy, shape (n, 3)."""
    bridged: np.ndarray
    """Which of them were not seen, as something stands on them: there they lie on a smooth bridge, bool, (n,)."""
    raised: np.ndarray
    """Points that stand on the skin: hair, straps, markers [mm], shape (k, 3)."""
    hidden: np.ndarray
    """Points that hang together with the skin in front of it, as the front of the body [mm], shape (m, 3)."""
    surroundings: np.ndarray
    """Points that do not hang together with it: walls, tables, stray points [mm], shape (i, 3)."""
    noise: float
    """Standard deviation of the points about the skin [mm]."""
    error: float
    """Standard deviation of a point of `skin`, which is smaller where the scan is smoothed [mm]."""

    stands: bool
    """Whether more than markers stands on it."""

    @property
    def left_out(self) -> int:
        """How many points, averaged in cubes, are not of the skin, or stand on it as more than a marker."""
        return len(self.surroundings) + len(self.hidden) + (len(self.raised) if self.stands else 0)

    @property
    def smoothed(self) -> bool:
        """Whether the scan is so noisy that its points were smoothed."""
        return self.noise > NOISY


def find_back(points: np.ndarray, line: np.ndarray, across: np.ndarray, what: str = "back") -> BackPoints:
    """Find the skin of a back: what lies around the line of the spine, hangs together, and is smooth across.

    Args:
        points: of the scan in mm and LPS, with its surroundings, shape (n, 3).
        line: of the spine, on the skin or in the bodies of the vertebrae, shape (m, 3) [mm].
        across: unit vector to the left in the axial plane, shape (2,).
        what: name of the scan in an error.

    Raises:
        InputError: fewer than `FEWEST_SEEN` points that are finite, or none that lies behind the line.
    """
    if points.ndim != 2 or points.shape[1:] != (3,) or len(points) < FEWEST_SEEN or not np.isfinite(points).all():
        raise InputError(f"{what}: needs {FEWEST_SEEN} or more finite points of shape (n, 3), not {points.shape}")
    thin = in_cubes(points)[0]
    if len(thin) < FEWEST_SEEN:
        places = f"its {len(points)} points lie in {len(thin)} places {SPACING:g} mm apart"
        raise InputError(f"{what}: {places}, and a back needs {FEWEST_SEEN}; give x, y and z in mm, or --units")
    seen = _from_behind(thin, across)
    to_line = seen - _line_at(line, across, thin[:, 2])
    usual = _usual_distance(thin)
    own = (np.abs(to_line[:, :2]) < WINDOW).all(axis=1)
    own &= ~_on_planes(thin, to_line)
    own[own] = _hangs_together(thin[own], to_line[own], max(LINK, 3.0 * usual), what)
    if own.sum() < FEWEST_SEEN:
        raise InputError(
            f"{what}: {own.sum()} points hang together behind the spine, and a back needs {FEWEST_SEEN}"
        )
    own[own] = ~_loose(thin[own])
    skin, surroundings = thin[own], thin[~own]
    behind = _hidden(seen[own], max(6.0, 2.5 * usual))
    skin, hidden = skin[~behind], skin[behind]
    noise = error = noise_of(skin, across)
    sharp, blur, sharp_error = skin, 0.0, noise
    if noise > NOISY:  # what stands on the back has edges, which the skin does not need
        blur = float(np.clip(EDGES[0] + EDGES[1] * noise, 8.0, 16.0))
        sharp, sharp_error = smoothed(skin, across, noise, blur)
        skin, error = smoothed(skin, across, noise, SMOOTHER * blur)
    seen = _from_behind(sharp, across)
    cell = max(4.0, 1.3 * _usual_distance(sharp))  # surroundings may be sparser than the skin
    grid = depth_grid(seen[:, [0, 2]], seen[:, 1], cell)
    columns, rows = grid.middles
    plate = find_raised(grid, columns[:, None] - _line_at(line, across, rows)[:, 0], sharp_error, blur)
    seen = _from_behind(skin, across)
    shown, on = skin, np.zeros(len(skin), dtype=bool)
    if plate is not None:
        on, depth = plate.over_skin(seen[:, [0, 2]], seen[:, 1], error)
        skin = skin + np.where(on, depth - seen[:, 1], 0.0)[:, None] * [-across[1], across[0], 0.0]
    skin, bump = without_bumps(skin, across)
    bridged = bump | on
    raised = shown[bridged]
    return BackPoints(skin, bridged, raised, hidden, surroundings, noise, error, plate is not None)


def points_on(surface: Surface) -> np.ndarray:
    """The vertices of a surface and points on its triangles, one for `_POINT_AREA` of area, shape (n, 3) [mm]."""
    area = np.linalg.norm(area_vectors(surface.vertices, surface.faces), axis=1)
    rng = np.random.default_rng(0)
    face = np.repeat(np.arange(len(area)), rng.poisson(area / _POINT_AREA))
    weights = rng.dirichlet(np.ones(3), len(face))
    inside = np.einsum("nk,nki->ni", weights, surface.vertices[surface.faces[face]])
    return np.vstack([surface.vertices[np.unique(surface.faces)], inside])


def _from_behind(points: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Points (n, 3) by how far they lie to the left, to the back and up, shape (n, 3) [mm]."""
    return np.column_stack([points[:, :2] @ np.array([across, [-across[1], across[0]]]).T, points[:, 2]])


def _line_at(line: np.ndarray, across: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """The line at heights (n,), to the left, to the back and up; beyond its ends the end, shape (n, 3) [mm]."""
    rising = _from_behind(line, across)
    rising = rising[np.argsort(rising[:, 2])]
    return np.column_stack([np.interp(heights, rising[:, 2], rising[:, axis]) for axis in range(3)])


def _usual_distance(points: np.ndarray) -> float:
    """Median distance of points (n, 3) from their nearest neighbours [mm]."""
    from scipy.spatial import KDTree

    some = points[:: max(1, len(points) // _SAMPLE)]
    return float(np.median(KDTree(points).query(some, k=2)[0][:, 1]))


def _on_planes(points: np.ndarray, to_line: np.ndarray) -> np.ndarray:
    """Which points (n, 3) are of a wall, a table or a floor, bool: of a plane that reaches beyond the trunk.

    Planes are drawn through three points each of those that are farther than `_BESIDE` from the spine (RANSAC,
    Fischler and Bolles 1981, Commun ACM 24:381).
    """
    on_plane = np.zeros(len(points), dtype=bool)
    near = (np.abs(to_line[:, 0]) < CORRIDOR) & (to_line[:, 1] > LAYER[0]) & (to_line[:, 1] < LAYER[1])
    rng = np.random.default_rng(0)
    for _ in range(6):
        far = points[~on_plane & (np.hypot(*to_line[:, :2].T) > _BESIDE)]
        if len(far) < _PLANE:
            break
        some = far[rng.choice(len(far), min(len(far), 2000), replace=False)]
        corners = some[rng.integers(len(some), size=(300, 3))]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
        off = np.abs(some @ normals.T - np.einsum("ni,ni->n", normals, corners[:, 0]))
        best = int((off < _ON_PLANE).sum(axis=0).argmax())
        of_plane = some[off[:, best] < _ON_PLANE]
        middle = of_plane.mean(axis=0)
        normal = np.linalg.svd(of_plane - middle, full_matrices=False)[2][2]
        on = np.abs((far - middle) @ normal) < _ON_PLANE
        if len(np.unique(np.floor(far[on] / 10.0), axis=0)) < _PLANE:
            break
        on_plane |= (np.abs((points - middle) @ normal) < 2.0 * _ON_PLANE) & ~near
    return on_plane


def _hangs_together(points: np.ndarray, to_line: np.ndarray, size: float, what: str) -> np.ndarray:
    """Which points (n, 3) hang together with what lies first behind the line, bool.

    Raises:
        InputError: nothing does.
    """
    from scipy import ndimage

    behind = (np.abs(to_line[:, 0]) < CORRIDOR) & (to_line[:, 1] > LAYER[0]) & (to_line[:, 1] < LAYER[1])
    behind &= np.abs(to_line[:, 2]) < CORRIDOR
    if not behind.any():
        gap = np.linalg.norm(to_line, axis=1).min(initial=np.inf)
        rule = f"no part of it lies behind the spine within {CORRIDOR:g} mm to its sides, and the nearest point"
        raise InputError(
            f"{what}: {rule} is {gap:.0f} mm away; give scan and spine in one frame, in mm and LPS axes"
        )
    cube = np.floor((points - points.min(axis=0)) / size).astype(np.int64)
    full = np.zeros(cube.max(axis=0) + 1, dtype=bool)
    full[tuple(cube.T)] = True
    pieces = np.empty(full.shape, dtype=np.int32)
    ndimage.label(full, np.ones((3, 3, 3)), output=pieces)
    piece = pieces[tuple(cube.T)]
    at = np.flatnonzero(behind)
    at = at[np.argsort(to_line[at, 1])]
    column = np.floor(np.column_stack([to_line[at, 0], points[at, 2]]) / size).astype(np.int64)
    first = at[np.unique(column, axis=0, return_index=True)[1]]
    votes = np.bincount(piece[first])
    return np.isin(piece, np.flatnonzero(votes > 0.1 * len(first)))


def _loose(points: np.ndarray) -> np.ndarray:
    """Which points (n, 3) have no skin around them, bool."""
    from scipy.spatial import KDTree

    sixth = KDTree(points).query(points, k=min(7, len(points)))[0][:, -1]
    return sixth > _LOOSE * np.median(sixth)


def _hidden(seen: np.ndarray, cell: float) -> np.ndarray:
    """Which points, given to the left, back and up (n, 3), lie in front of others, bool."""
    place = np.floor((seen[:, [0, 2]] - seen[:, [0, 2]].min(axis=0)) / cell).astype(np.int64)
    last = np.full(place.max(axis=0) + 1, -np.inf)
    np.maximum.at(last, tuple(place.T), seen[:, 1])
    return seen[:, 1] < last[tuple(place.T)] - _HIDDEN


def noise_of(points: np.ndarray, across: np.ndarray) -> float:
    """Standard deviation of points (n, 3) about the skin [mm], from quadratics through their neighbours."""
    from scipy.spatial import KDTree

    seen = _from_behind(points, across)
    tree = KDTree(seen[:, [0, 2]])
    some = np.arange(0, len(seen), max(1, len(seen) // _SAMPLE))
    near = np.asarray(tree.query(seen[some][:, [0, 2]], k=min(_NEAR, len(seen)))[1])
    terms = _quadratic(seen[near] - seen[some][:, None])
    depth = seen[near, 1]
    fit = np.linalg.pinv(terms) @ depth[..., None]
    left = (depth[..., None] - terms @ fit)[..., 0] / np.hypot(1.0, np.hypot(fit[:, 1], fit[:, 2]))
    free = near.shape[1] / max(near.shape[1] - terms.shape[2], 1)
    return float(1.4826 * np.median(np.abs(left)) * np.sqrt(free))


def _quadratic(off: np.ndarray) -> np.ndarray:
    """Terms of a quadratic in places (..., 3) to the left and up, shape (..., 6)."""
    x, z = off[..., 0], off[..., 2]
    return np.stack([np.ones_like(x), x, z, x * x, x * z, z * z], axis=-1)


def smoothed(points: np.ndarray, across: np.ndarray, noise: float, radius: float) -> tuple[np.ndarray, float]:
    """A noisy back as points of a grid, and the standard deviation of their depth [mm].

    Each is the value of a quadratic through the points around it (`TALLER`), fitted by Tukey's biweight, so that
    stray points have no weight.

    Args:
        points: of the back, shape (n, 3) [mm].
        across: unit vector to the left in the axial plane, shape (2,).
        noise: of the points [mm].
        radius: to the sides of the points around that count [mm].
    """
    from scipy.spatial import KDTree

    seen = _from_behind(points, across)
    places = seen[:, [0, 2]] / [1.0, TALLER]
    low, high, step = places.min(axis=0), places.max(axis=0), (4.0, 5.0 / TALLER)
    sides = [np.arange(*side) for side in zip(low, high, step, strict=True)]
    node = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 2)
    tree = KDTree(places)
    sampled = tree.query_ball_point(places[:: max(1, len(places) // 200)], radius)
    many = int(np.median([len(near) for near in sampled]))
    count = min(max(many, 12), 450)
    gap, near = map(np.asarray, tree.query(node, k=count, distance_upper_bound=radius))
    full = (np.isfinite(gap).sum(axis=1) > 0.35 * count) & (np.isfinite(gap[:, :6]).all(axis=1))
    node, gap, near = node[full], gap[full], near[full]
    depths, leverage, regular = [], [], 1e-6 * np.eye(6)
    for start in range(0, len(node), 200):  # of the size of a cache
        part = slice(start, start + 200)
        inside = np.isfinite(gap[part])
        rows = np.where(inside, near[part], 0)
        off = np.zeros((*rows.shape, 3))
        off[..., [0, 2]] = (places[rows] - node[part][:, None]) / radius
        terms, depth = _quadratic(off), seen[rows, 1]
        kernel = np.where(inside, np.maximum(1.0 - np.square(np.minimum(gap[part] / radius, 1.0)), 0.0), 0.0)
        weights, scale, fit = kernel, 6.0 * noise, np.zeros((len(rows), terms.shape[2], 1))
        for _ in range(5):
            weighted = (weights[..., None] * terms).swapaxes(1, 2)
            fit = np.linalg.solve(weighted @ terms + regular, weighted @ depth[..., None])
            left = depth - (terms @ fit)[..., 0]
            weights = kernel * np.square(np.maximum(1.0 - np.square(left / scale), 0.0))
            scale = 4.7 * noise
        moment = (weights[..., None] * terms).swapaxes(1, 2) @ terms + regular
        first = np.linalg.solve(moment, np.eye(6)[:, :1])  # row of the inverse that gives the depth
        leverage.append(np.vecdot(np.square(weights * (terms @ first)[..., 0]), inside))
        depths.append(fit[:, 0, 0])
    depth, share = np.concatenate(depths), np.concatenate(leverage)
    good = share < 1.0
    behind = np.array([-across[1], across[0]])
    places_on_grid = node[good, :1] * across + depth[good, None] * behind
    smooth = np.column_stack([places_on_grid, TALLER * node[good, 1]])
    return smooth, float(noise * np.sqrt(np.median(share[good])))
