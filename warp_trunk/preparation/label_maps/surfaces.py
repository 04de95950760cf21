"""From the voxels of a bone to its surface, without the stairs and with its volume."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import Grid
from warp_trunk.geometry.isosurface import one_solid, zero_surface
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import enclosed_volume

from .mask import Mask, distance, largest_piece, reduced

_FINE = 1.65
"""Voxels are joined in blocks whose sides stay below this [mm]: bones are meshed at 4 mm in the end."""
_LEAST = 30
"""A label of fewer voxels is no bone."""
_ROOM = 3
"""Voxels of the outside around the box."""
KEPT = 0.003
"""How far the volume of a surface may be from that of its voxels, relative."""
_TRIES = 5
_FIRST_SLOPE = 1.4
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

    if np.count_nonzero(mask.inside) < _LEAST:
        raise InputError(
            f"{name}: has {np.count_nonzero(mask.inside)} voxels, {_LEAST} are needed; look at this label"
        )
    kept, sizes = largest_piece(mask.inside)
    volume = float(sizes[0]) * mask.voxel_volume
    factors = tuple(max(1, int(_FINE / side)) for side in mask.spacing)
    # voxels joined in blocks; the middle of the first block, in voxels
    solid = np.pad(reduced(kept, factors) >= 0.5, _ROOM)
    spacing = mask.spacing * factors
    field = ndimage.gaussian_filter(distance(solid, spacing), smoothing / spacing)
    block = mask.voxel_volume * float(np.prod(factors))
    level = _level_of(field, volume / block)
    surface = zero_surface(one_solid(field - level, 1.0), _unit_grid(field))
    vertices = mask.place((surface.vertices - _ROOM) * factors + 0.5 * (np.array(factors) - 1.0))
    mirrored = np.linalg.det(mask.affine[:3, :3]) < 0.0
    surface = Surface(vertices, surface.faces[:, ::-1].copy() if mirrored else surface.faces)
    return BoneShape(
        surface=surface,
        volume=volume,
        change=enclosed_volume(surface) / volume - 1.0,
        dropped=tuple(float(size) * mask.voxel_volume for size in sizes[1:]),
    )


def _level_of(field: np.ndarray, volume: float) -> float:
    """At which level a field holds a volume [voxels], by the secant method."""
    level, held = 0.0, _volume(field)
    step = float(np.cbrt(volume)) * (volume - held) / max(held, 1.0) / 3.0 * _FIRST_SLOPE
    for _ in range(_TRIES):
        if abs(held / volume - 1.0) <= KEPT / 3.0 or step == 0.0:
            break
        before, old = held, level
        level += step
        held = _volume(field - level)
        if held == before:
            break
        step = (volume - held) * (level - old) / (held - before)
    return level


def _volume(field: np.ndarray) -> float:
    if not (field < 0.0).any():
        return 0.0
    return enclosed_volume(zero_surface(field, _unit_grid(field)))


def _unit_grid(field: np.ndarray) -> Grid:
    x, y, z = field.shape
    return Grid(np.zeros(3), 1.0, (x, y, z))
