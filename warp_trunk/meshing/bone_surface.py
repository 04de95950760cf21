"""One clean surface around many bones, which may overlap, cross themselves or poke through the skin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.coarsening import coarsen
from warp_trunk.geometry.core_threads import each_over_cores
from warp_trunk.geometry.distance_field import (
    Box,
    Grid,
    SurfaceDistance,
    connected_patches,
    nearest_surface,
    zero_surface,
)
from warp_trunk.geometry.surface import Surface, check_surface
from warp_trunk.geometry.surface_checks import crossings, manifold_fault, place_of

_BAND = 2.0
"""Distances are worked out to this many voxels from a surface."""
_SPECK = 8
"""Pieces with fewer grid nodes inside than this are dropped: the grid cannot hold their shape."""
_GAP = 0.5
"""Bones nearer to each other than this many voxels merge, so that no wedge of tissue is left between."""
_TRIES = 3
"""How often the surface is made, each time on a finer grid, before giving up."""
_FINER = 0.75
"""Ratio of the voxels of one try and the one before."""


@dataclass(frozen=True)
class BoneSurface:
    """A closed 2-manifold that does not cross itself, and the bone of each of its vertices."""

    surface: Surface
    """Triangles counterclockwise seen from outside the bone, that is from the soft tissue."""
    bone: np.ndarray
    """Which bone each vertex is nearest to, in the order they were given, shape (vertices,), int32."""
    voxel: float
    """Grid spacing it was made with [mm]; smaller than asked for if that one failed."""


def bone_surface(
    skin: Surface,
    bones: Mapping[str, Surface],
    margin: float = 2.0,
    voxel: float = 4.0,
    edge_length: float = 8.0,
    tolerance: float = 1.0,
) -> BoneSurface:
    """Make one surface of many bones, inside the skin.

    The bones become one signed distance field on a grid (the least distance over the bones, the sign by
    winding number, so that overlaps and self-intersections do no harm), cut off where the skin is nearer
    than the margin; marching cubes find its zero surface; cavities inside bone and specks are dropped; short
    edges are collapsed. Bones nearer to each other than half a voxel merge; the bone of each vertex is the
    one whose own surface is nearest. A plate or rod thinner than the voxel may break into pieces.

    Args:
        skin: the closed skin.
        bones: closed surfaces by name.
        margin: no bone comes nearer to the skin than this [mm]; a bone that pokes out is cut back.
        voxel: spacing of the grid [mm]; made finer if the surface fails its checks or a bone is lost.
        edge_length: edges shorter than this [mm] are collapsed where shape allows.
        tolerance: how far collapses may move the surface [mm], see coarsen.

    Raises InputError when there are no bones, when a bone leaves no part of the surface, or when no grid
    gives a clean surface.
    """
    for name, bone in bones.items():
        check_surface(bone, f"bone '{name}'")
    distances = [SurfaceDistance(bone) for bone in bones.values()]
    skin_distance = SurfaceDistance(skin)
    names = tuple(bones)
    fault = ""
    for _ in range(_TRIES):
        solid = _isosurface(distances, skin_distance, margin, voxel)
        if solid is None:
            fault = "no bone is left inside the skin less the margin"
        else:
            surface = coarsen(solid, edge_length, tolerance)
            bone = nearest_surface(surface.vertices, distances, _BAND * voxel)
            fault = _fault(surface, bone, names)
            if not fault:
                return BoneSurface(surface, bone, voxel)
        voxel *= _FINER
    cure = "look at the bones there, or change bone_voxel or bone_margin"
    raise InputError(f"bones: no clean surface down to a voxel of {voxel / _FINER:.3g} mm: {fault}; {cure}")


def _isosurface(
    distances: list[SurfaceDistance], skin_distance: SurfaceDistance, margin: float, voxel: float
) -> Surface | None:
    """The zero surface of max(min over bones, skin + margin), without cavities and specks."""
    field, grid = _field(distances, skin_distance, margin, voxel)
    # marching cubes join diagonal neighbours inside, so pieces are counted in that way
    pieces = connected_patches(field < 0.0, diagonally=True)
    specks = np.bincount(pieces.reshape(-1)) < _SPECK
    field[specks[pieces] & (pieces > 0)] = voxel
    outside = connected_patches(field >= 0.0)
    if not (field < 0.0).any():
        return None
    field[(outside > 0) & (outside != outside[0, 0, 0])] = -voxel  # cavities in bone are no soft tissue
    return zero_surface(field, grid)


def _field(
    distances: list[SurfaceDistance], skin_distance: SurfaceDistance, margin: float, voxel: float
) -> tuple[np.ndarray, Grid]:
    band = _BAND * voxel
    lower = np.min([d.lower for d in distances], axis=0) - (band + voxel)
    upper = np.max([d.upper for d in distances], axis=0) + (band + voxel)
    grid = Grid.over(lower, upper, voxel)
    field = np.full(grid.shape, band, dtype=np.float32)

    def near_surface(distance: SurfaceDistance) -> tuple[Box, np.ndarray]:
        box = grid.box(distance.lower - band, distance.upper + band)
        return box, distance.on_grid(grid, box, np.ones(field[box].shape, dtype=bool), band)

    second = field.copy()
    for box, near in each_over_cores(near_surface, distances):
        second[box] = np.minimum(second[box], np.maximum(field[box], near))
        field[box] = np.minimum(field[box], near)
    field = np.minimum(field, 0.5 * (field + second - _GAP * voxel))  # of the two nearest bones

    whole = tuple(slice(0, count) for count in grid.shape)
    wanted = field < 1.01 * voxel  # farther out no node has a neighbour inside, so that the surface is elsewhere
    depth = skin_distance.on_grid(grid, whole, wanted, band + margin) + margin
    field[wanted] = np.maximum(field[wanted], depth[wanted])
    return field, grid


def _fault(surface: Surface, bone: np.ndarray, names: tuple[str, ...]) -> str:
    """The fault of a bone surface, or an empty text."""
    lost = [name for number, name in enumerate(names) if not (bone == number).any()]
    if lost:
        why = "it is thinner than the voxel, buried in another bone, or outside the skin less the margin"
        return f"bone '{lost[0]}' leaves no part of it ({len(lost)} such); {why}"
    if fault := manifold_fault(surface):
        return fault
    pairs = crossings(surface)
    where = f"{len(pairs)} of its triangles cross others, the first near"
    return f"{where} {place_of(surface, pairs[0])}" if len(pairs) else ""
