"""From open, partial, noisy scans of a trunk to one closed surface that can be meshed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from warp_trunk.errors import InputError, check_ranges
from warp_trunk.geometry.coarsening import coarsen, without_slivers
from warp_trunk.geometry.distance_field import Grid
from warp_trunk.geometry.isosurface import one_solid, zero_surface
from warp_trunk.geometry.normals import vertex_areas
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import check_solid

from .cutting import CutPlane, cut_flat, cut_within, goes_on_beyond
from .fitting import fit_to_points
from .openings import Opening, find_openings, patches, rim_of
from .parts import check_parts, covers, reach_of
from .winding import sheet_samples, winding_field

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
    """How scans become one closed skin."""

    edge_length: float = 7.0
    """Length of the edges of the result [mm]; 7 gives a trunk of about 30,000 triangles."""
    smoothing: float = 6.0
    """Details shorter than about six times this are taken for noise [mm]; 0 to 3 for a clean scan."""

    def __post_init__(self) -> None:
        check_ranges(self, "close", edge_length=(1.0, 50.0), smoothing=(0.0, 30.0))


@dataclass(frozen=True)
class ClosedSkin:
    """A closed skin, and what of it no scan has seen."""

    surface: Surface
    """A closed 2-manifold without handles that does not cross itself, oriented outward."""
    openings: tuple[Opening, ...]
    """The closed openings, largest first."""


def close_skin(
    parts: Mapping[str, Surface], cuts: Sequence[CutPlane] = (), options: CloseOptions | None = None
) -> ClosedSkin:
    """Make one closed skin of scans that overlap in one frame, or of one skin with holes.

    The level 0.5 of the winding number of all scans together, each weighted down where others have seen the
    same skin, is a closed surface whatever is missing. Drawn to the measured points as a thin plate, it
    averages their noise and goes on into the holes with the curvature of the skin around them. Then it is cut
    flat where the scans end and where asked.

    >>> open_skin = wt.Surface(case.skin.vertices, case.skin.faces[40:])
    >>> closed = wt.close_skin({"scan": open_skin})
    >>> len(closed.openings) >= 1
    True

    Args:
        parts: the scans by name, oriented outward; mm, LPS.
        cuts: where to cut flat besides.
        options: how; CloseOptions() if not given.

    Raises InputError when the parts are no trunk (see check_parts), or when no clean surface comes of them.
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
    return ClosedSkin(skin, tuple(openings))


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
