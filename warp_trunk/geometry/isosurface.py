"""The surface on which a field on a grid is zero."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from .distance_field import Grid, largest_piece
from .surface import Surface

_NUDGE = 0.05
"""A crossing nearer to a grid node than this part of the spacing would make slivers; it is moved away."""


def zero_surface(field: np.ndarray, grid: Grid) -> Surface:
    """Marching cubes around where a field is negative, triangles counterclockwise seen from outside.

    Args:
        field: signed like a distance and of its size near zero [mm], shape of the grid; positive on its border.
        grid: the nodes.
    """
    import warp.geometry as geometry  # its kernels compile on first use

    nudge = _NUDGE * grid.spacing
    field = np.where(np.abs(field) < nudge, np.where(field < 0.0, -nudge, nudge), field)
    upper = (np.array(grid.shape) - 1) * grid.spacing
    values: Any = wp.array(field, dtype=wp.float32, device="cpu")
    vertices, corners = geometry.IsoSurfaceMarchingCubes.extract(
        values, 0.0, lower=wp.vec3(0.0), upper=wp.vec3(*upper.tolist())
    )
    return Surface(vertices.numpy().astype(np.float64) + grid.lower, corners.numpy().reshape(-1, 3))


def one_solid(field: np.ndarray, away: float) -> np.ndarray:
    """The field with only the largest connected part of its inside, and no cavity in that.

    Args:
        field: negative inside, positive on the border of the grid.
        away: what the rest becomes, with the sign of where it then lies.
    """
    from scipy import ndimage  # heavy

    # marching cubes join diagonal neighbours inside, so parts are counted in that way
    inside = np.asarray(ndimage.binary_fill_holes(largest_piece(field < 0.0)[0]))
    return np.where(inside == (field < 0.0), field, np.where(inside, -away, away))
