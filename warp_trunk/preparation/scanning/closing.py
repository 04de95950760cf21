"""From open, partial, noisy scans of a trunk to one closed surface that can be meshed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from warp_trunk.checking import check_fields, checked
from warp_trunk.errors import InputError
from warp_trunk.geometry.coarsening import coarsen, without_slivers
from warp_trunk.geometry.colours import coloured_from
from warp_trunk.geometry.cutting import CutPlane, cut_flat, cut_within, goes_on_beyond
from warp_trunk.geometry.distance_field import Grid, one_solid, zero_surface
from warp_trunk.geometry.surface import (
    Surface,
    area_vectors,
    corner_areas,
    directed_edges,
    side_lengths,
    unit,
    vertex_areas,
)
from warp_trunk.geometry.surface_checks import boundary_edges, check_solid, linked_parts
from warp_trunk.geometry.surface_fit import fit_to_points

from .parts import check_parts, covers, reach_of

_GRID = 0.7
"""Spacing of the winding number's grid, in edge lengths of the result."""
_OPEN = 2.0
"""Places farther than this many spacings from every scan are open."""
_RINGS = 4
"""How many triangles wide the seen skin around an end is that may be cut with it."""
_AT_CUT = 30.0
"""A cut takes the place of an end that is not farther inside it than this [mm]."""
_NOISE = 5.0
"""Scans of one place may lie this far apart [mm]."""


@dataclass(frozen=True, kw_only=True)
class CloseOptions:
    """How scans become one closed skin.

    >>> wt.CloseOptions(smoothing=0.0).edge_length
    7.0
    """

    edge_length: Annotated[float, Meta(ge=1.0, le=50.0, description="mm")] = 7.0
    """Length of the edges of the result [mm]; 7 gives a trunk of about 30,000 triangles."""
    smoothing: Annotated[float, Meta(ge=0.0, le=30.0, description="mm")] = 6.0
    """Details shorter than about six times this are taken for noise [mm]; 0 to 3 for a clean scan."""

    def __post_init__(self) -> None:
        check_fields(self, "close")


@dataclass(frozen=True)
class ClosedSkin:
    """A closed skin, and what of it no scan has seen."""

    surface: Surface
    """A closed 2-manifold without handles that does not cross itself, oriented outward."""
    openings: tuple[Opening, ...]
    """The closed openings, largest first."""


@checked
def close_skin(
    parts: Mapping[str, Surface], cuts: Sequence[CutPlane] = (), options: CloseOptions | None = None
) -> ClosedSkin:
    """Make one closed skin of scans that overlap in one frame, or of one skin with holes.

    The level 0.5 of the winding number of all scans together, each weighted down where others have seen the
    same skin, is a closed surface whatever is missing. Drawn to the measured points as a thin plate, it
    averages their noise and goes on into the holes with the curvature of the skin around them. Then it is cut
    flat where the scans end and where asked. It has the colours of the nearest scan.

    >>> open_skin = wt.Surface(case.skin.vertices, case.skin.faces[40:])
    >>> closed = wt.close_skin({"scan": open_skin})
    >>> len(closed.openings) >= 1
    True

    Args:
        parts: the scans by name, oriented outward; mm, LPS.
        cuts: where to cut flat besides.
        options: how; CloseOptions() if not given.

    Raises InputError when the parts are no trunk (see check_parts), show too little of one (see check_seen), or
    when no clean surface comes of them.
    """
    options = options or CloseOptions()
    check_parts(parts)
    points = np.concatenate([part.vertices for part in parts.values()])
    areas = np.concatenate([vertex_areas(part) for part in parts.values()])
    in_use = np.linalg.norm(areas, axis=1) > 0.0
    points, areas = points[in_use], areas[in_use]

    spacing = _GRID * options.edge_length
    reaches = {name: reach_of(part, _NOISE) for name, part in parts.items()}
    lid, samples = _level_set(parts, reaches, spacing)
    openings = find_openings(lid, samples, rim_of(parts, reaches), _OPEN * spacing)
    check_seen(lid, openings, ", ".join(parts))
    skin = fit_to_points(coarsen(lid, options.edge_length, 1.0), points, areas, options.smoothing, 3.0 * spacing)
    for number, end in enumerate(openings):
        if end.is_end and not any(_near(end, cut) for cut in cuts):
            flat = _flatten(skin, end, samples, _OPEN * spacing, options.edge_length)
            openings[number] = replace(end, is_end=flat is not None)
            skin = flat or skin
    skin = without_slivers(cut_flat(skin, cuts, options.edge_length))
    check_solid(skin, "closed skin")
    if handles := 1 - (len(skin.vertices) - len(skin.faces) // 2) // 2:
        cure = "give a shorter edge_length, or scans without the arms"
        raise InputError(f"closed skin: has {handles} handles, where parts of the skin touch; {cure}")
    return ClosedSkin(coloured_from(skin, parts.values()), tuple(openings))


MOST_UNSEEN = 0.25
"""Share of the closed skin that holes may make up."""
_LIMB = 15_000.0
"""An end that is larger than the stump of an arm [mm^2] is that of the neck or the thighs, or no end at all."""


def check_seen(lid: Surface, openings: Sequence[Opening], where: str) -> None:
    """InputError where more than `MOST_UNSEEN` of a closed surface was seen by no scan.

    Ends of the trunk do not count: stumps of arms, and what faces up or down as neck and thighs do.

    Args:
        lid: the closed surface.
        openings: those of `find_openings`.
        where: names of the scans.
    """
    holes = [o for o in openings if not (o.is_end and (o.area < _LIMB or abs(o.normal[2]) > _UPRIGHT))]
    share = sum(hole.area for hole in holes) / float(corner_areas(lid).sum())
    if share > MOST_UNSEEN:
        axis = int(np.abs(holes[0].normal).argmax())
        sides = (("right", "left"), ("front", "back"), ("bottom", "top"))[axis]
        side = sides[int(holes[0].normal[axis] > 0.0)]
        place = "({:.0f}, {:.0f}, {:.0f}) mm".format(*holes[0].centre)
        most = f"{100.0 * MOST_UNSEEN:g} %"
        rule = f"{100.0 * share:.0f} % of the closed skin, mostly its {side} at {place}, {most} is"
        cure = "scan the rest, or make a case of a scan of the back with warp-trunk fit-back"
        raise InputError(f"{where}: no scan shows {rule} the most; {cure}")


def _level_set(
    parts: Mapping[str, Surface], reaches: Mapping[str, float], spacing: float
) -> tuple[Surface, np.ndarray]:
    """Where the winding number is 0.5, and the samples of the scans it was made of, shape (n, 3) [mm]."""
    sampled = []
    for name, part in parts.items():
        points, areas = sheet_samples(part, spacing)
        sampled.append((points, areas / (1.0 + covers(parts, reaches, name, points, areas))[:, None]))
    points, areas = map(np.concatenate, zip(*sampled, strict=True))
    grid = Grid.over(points.min(axis=0) - 6.0 * spacing, points.max(axis=0) + 6.0 * spacing, spacing)
    # across a sheet the number falls by 1 over some three spacings
    field = 3.0 * spacing * (0.5 - winding_field(points, areas, grid))
    return zero_surface(one_solid(field, spacing), grid), points


def _near(end: Opening, cut: CutPlane) -> bool:
    """Whether a cut that was asked for takes the place of an end found."""
    return bool(cut.near(end.centre[None]).all() and cut.distance(end.centre) > -_AT_CUT)


def _flatten(skin: Surface, end: Opening, samples: np.ndarray, reach: float, edge_length: float) -> Surface | None:
    """Cut what stands over the plane of an end; of the skin that was seen, a few rings at most.

    None where that is not enough, because the skin around goes on beyond the plane.
    """
    from scipy.spatial import KDTree  # heavy

    plane = CutPlane.at(end.centre, end.normal)
    unseen = KDTree(samples).query(skin.vertices)[0] > reach
    part = patches(skin, unseen)
    nearest = np.where(unseen, np.linalg.norm(skin.vertices - end.centre, axis=1), np.inf).argmin()
    near = unseen & (part == part[nearest])
    for _ in range(_RINGS):
        near[skin.faces[near[skin.faces].any(axis=1)]] = True
    if not (near & (plane.distance(skin.vertices) > 0.0)).any() or goes_on_beyond(skin, plane, near, edge_length):
        return None
    return cut_within(skin, plane, near, edge_length)


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
        normals.append(unit(area[alone]))
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
        close = off <= max(3.0 * float(np.median(off)), 0.5)
        centre = points[close].mean(axis=0)
        axis = np.linalg.svd(points[close] - centre, full_matrices=False)[2][2]
        normal = axis if axis @ normal > 0.0 else -axis
    return centre, normal, float(off.mean())


def patches(surface: Surface, chosen: np.ndarray) -> np.ndarray:
    """A number for each vertex, the same for two that are joined by edges between chosen ones (bool)."""
    first, second = directed_edges(surface.faces)
    joined = chosen[first] & chosen[second]
    return linked_parts(first[joined], second[joined], len(chosen))


def sheet_samples(surface: Surface, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Cut each triangle into equal ones no longer than the spacing [mm].

    Returns their centroids (n, 3) [mm] and their area vectors (n, 3) [mm^2], of the length of the area along the
    outward normal. The area vectors of a closed surface sum to zero.
    """
    corners = surface.vertices[surface.faces]
    splits = np.maximum(np.ceil(side_lengths(surface).max(axis=1) / spacing), 1).astype(int)
    area = area_vectors(surface.vertices, surface.faces)
    points, areas = [], []
    for count in np.unique(splits):
        of_count = np.flatnonzero(splits == count)
        weights = _centroids(int(count))
        points.append(np.einsum("sk,fki->fsi", weights, corners[of_count]).reshape(-1, 3))
        areas.append(np.repeat(area[of_count] / count**2, count**2, axis=0))
    return np.concatenate(points), np.concatenate(areas)


def winding_field(points: np.ndarray, areas: np.ndarray, grid: Grid) -> np.ndarray:
    """Generalized winding number of oriented samples at the nodes of a grid, shape of the grid, float32.

    w(q) = sum over samples of a.(p - q) / (4 pi |p - q|^3), the solid angle under which the sheets are seen
    from q, by 4 pi (Jacobson et al. 2013; for oriented points Barill et al. 2018). It is 1 inside a closed
    surface and 0 outside; across an open sheet it falls by 1, and in an opening its level 0.5 spans the rim,
    flat where the rim is. The samples are spread over the nodes around them and the sum is one convolution, so
    it is smooth over some two spacings: sheets that lie on each other within the noise of a scan become one.

    Args:
        points: positions [mm], shape (n, 3), inside the grid by three spacings.
        areas: area times outward normal [mm^2], shape (n, 3); where m sheets overlap, each a 1/m of its area.
        grid: the nodes.
    """
    import scipy.fft  # heavy
    from scipy import ndimage

    fft: Any = scipy.fft  # its types say nothing
    shape = [fft.next_fast_len(2 * n, real=True) for n in grid.shape]
    steps = [(grid.spacing * n * np.fft.fftfreq(n)).astype(np.float32) for n in shape]
    offsets = np.meshgrid(*steps, indexing="ij", sparse=True)
    square = offsets[0] ** 2 + offsets[1] ** 2 + offsets[2] ** 2
    square[0, 0, 0] = np.inf  # a sample does not see itself
    decay = -1.0 / (4.0 * np.pi * square * np.sqrt(square))
    total: Any = 0.0
    for axis in range(3):
        spread = ndimage.gaussian_filter(_spread(points, areas[:, axis], grid), 1.0, mode="constant")
        total = total + fft.rfftn(spread, s=shape, workers=2) * fft.rfftn(offsets[axis] * decay, workers=2)
    nx, ny, nz = grid.shape
    return fft.irfftn(total, s=shape, workers=2)[:nx, :ny, :nz].astype(np.float32)


def _spread(points: np.ndarray, values: np.ndarray, grid: Grid) -> np.ndarray:
    """Each value shared among the eight nodes around its point by trilinear weights."""
    at = (points - grid.lower) / grid.spacing
    first = np.floor(at).astype(np.int64)
    share = at - first
    field = np.zeros(np.prod(grid.shape))
    for corner in np.ndindex(2, 2, 2):
        weight = np.where(np.array(corner) == 1, share, 1.0 - share).prod(axis=1)
        node = np.ravel_multi_index(tuple((first + corner).T), grid.shape)
        field += np.bincount(node, weight * values, minlength=len(field))
    return field.reshape(grid.shape).astype(np.float32)


def _centroids(count: int) -> np.ndarray:
    """Weights of the corners at the centroids of the count^2 equal parts of a triangle, shape (count^2, 3)."""
    upright = [(3 * i + 1, 3 * j + 1) for i in range(count) for j in range(count - i)]
    upside_down = [(3 * i + 2, 3 * j + 2) for i in range(count) for j in range(count - i - 1)]
    two = np.array(upright + upside_down) / (3.0 * count)
    return np.column_stack([two, 1.0 - two.sum(axis=1)])
