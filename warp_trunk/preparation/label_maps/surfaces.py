"""From the voxels of a bone to its surface, without the stairs and with its volume."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import Grid, largest_piece, one_solid, zero_surface
from warp_trunk.geometry.surface import Surface, area_vectors
from warp_trunk.geometry.surface_checks import components, enclosed_volume

from .mask import Mask, distance, factors_below, reduced

_FINE = 1.65
"""Voxels are joined in blocks whose sides stay below this [mm]: bones are meshed at 4 mm in the end."""
LEAST_VOXELS = 30
"""A label of fewer voxels is no bone."""
_ROOM = 3
"""Voxels of the outside around the box."""
VOLUME_KEPT = 0.003
"""How far the volume of a surface may be from that of its voxels, relative."""
_TRIES = 5
_SLOPE = 1.4
"""By how much the smoothed distance changes across the surface for each mm, about."""


@dataclass(frozen=True, eq=False)
class BoneShape:
    """The surface of a label, and what was done to it."""

    surface: Surface
    """Closed, of one piece [mm]."""
    volume: float
    """Of the voxels that it was made of [mm3]."""
    change: float
    """Of the volume by smoothing, relative."""
    dropped: tuple[float, ...]
    """Volumes of the pieces that do not hang together with the largest, largest first [mm3]."""


def bone_shape(mask: Mask, name: str, smoothing: float) -> BoneShape:
    """The surface of a label.

    The largest piece is kept. Its signed distance, from the centres of voxels on either side, is smoothed by a
    Gaussian, and the level is drawn that holds the volume of the voxels: a Gaussian alone would shrink what is
    round.

    Args:
        mask: the label.
        name: for messages.
        smoothing: standard deviation of the Gaussian [mm].

    Raises:
        InputError: a label of a few voxels only.
    """
    from scipy import ndimage  # heavy

    if (count := np.count_nonzero(mask.inside)) < LEAST_VOXELS:
        raise InputError(f"{name}: has {count} voxels, {LEAST_VOXELS} are needed; look at this label")
    largest, sizes = largest_piece(mask.inside)
    volume = float(sizes[0]) * mask.voxel_volume
    factors = factors_below(_FINE, mask.spacing)
    solid = np.pad(reduced(largest, factors) >= 0.5, _ROOM)
    spacing = mask.spacing * factors
    field = ndimage.gaussian_filter(distance(solid, spacing), smoothing / spacing)
    block = mask.voxel_volume * float(np.prod(factors))
    surface = _holding(field, volume / block, float(np.cbrt(np.prod(spacing))))
    mirrored = np.linalg.det(mask.affine[:3, :3]) < 0.0
    faces = surface.faces[:, ::-1].copy() if mirrored else surface.faces
    surface = Surface(mask.place_blocks(surface.vertices - _ROOM, factors), faces)
    dropped = tuple(float(size) * mask.voxel_volume for size in sizes[1:])
    return BoneShape(surface, volume, enclosed_volume(surface) / volume - 1.0, dropped)


def _holding(field: np.ndarray, volume: float, side: float) -> Surface:
    """The surface at the level at which a field holds a volume [voxels]; one solid.

    By the secant method. The first step is what is missing over the area of the surface, as far as it is known how
    steep the field is there.

    Args:
        field: signed distance, positive at the border [mm], shape (i, j, k).
        volume: what is to be held.
        side: of a voxel [mm].
    """
    level = 0.0 if (field < 0.0).any() else float(np.partition(field, int(volume), axis=None)[int(volume)])
    surface = _drawn(field - level)
    held = enclosed_volume(surface)
    area = float(np.linalg.norm(area_vectors(surface.vertices, surface.faces), axis=1).sum())
    step = _SLOPE * side * (volume - held) / area
    for _ in range(_TRIES):
        before, level = held, level + step
        if abs(held / volume - 1.0) <= VOLUME_KEPT / 3.0 or step == 0.0:
            break
        surface = _drawn(field - level)
        held = enclosed_volume(surface)
        if held == before:
            break
        step *= (volume - held) / (held - before)
    return surface


def _drawn(field: np.ndarray) -> Surface:
    """The zero surface, in voxels; only the largest part of what is inside, without a cavity."""
    grid = Grid(np.zeros(3), 1.0, field.shape)
    surface = zero_surface(field, grid)
    return surface if components(surface).max() == 0 else zero_surface(one_solid(field, 1.0), grid)
