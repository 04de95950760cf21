"""Colours of the vertices of a surface: from the numbers of a file, and from one surface to another."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from .surface import Surface


def as_colours(values: np.ndarray, vertices: np.ndarray) -> np.ndarray | None:
    """Red, green and blue as uint8, shape (vertices, 3); None where they say nothing.

    Where a number is missing (NaN, as scanners write outside their photographs), the colour is that of the nearest
    vertex that has one. Colours that are all the same, which programs write for a surface without a photograph,
    say nothing. Full colour is 1 where no value is larger, else 255, else 65535.

    Args:
        values: red, green and blue of each vertex, and whatever follows, shape (vertices, 3 or more).
        vertices: places [mm], shape (vertices, 3).
    """
    from scipy.spatial import KDTree  # heavy

    values = np.asarray(values, dtype=np.float64)[:, :3]
    coloured = np.isfinite(values).all(axis=1)
    if not coloured.any():
        return None
    if not coloured.all():
        nearest = np.asarray(KDTree(vertices[coloured]).query(vertices[~coloured])[1])
        values = values.copy()
        values[~coloured] = values[coloured][nearest]
    full = next((end for end in (1.0, 255.0) if values.max() <= end), 65535.0)
    if not np.ptp(values, axis=0).any():
        return None
    return np.rint(255.0 * np.clip(values / full, 0.0, 1.0)).astype(np.uint8)


def from_linear(values: np.ndarray) -> np.ndarray:
    """Amounts of light, which glTF has at vertices, as pictures have them; both from 0 to 1 (IEC 61966-2-1)."""
    return np.where(values <= 0.0031308, 12.92 * values, 1.055 * values ** (1.0 / 2.4) - 0.055)


def to_linear(values: np.ndarray) -> np.ndarray:
    """The inverse of `from_linear`."""
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def mean_colours(colours: np.ndarray, number: np.ndarray, count: int) -> np.ndarray:
    """The mean of the known colours (n, 3) with each number from 0 to `count` - 1; NaN where there is none."""
    coloured = np.isfinite(colours).all(axis=1)
    colours, number = colours[coloured], number[coloured]
    times = np.bincount(number, minlength=count)
    with np.errstate(invalid="ignore"):
        return np.column_stack([np.bincount(number, part, count) / times for part in colours.T])


def coloured_from(surface: Surface, sources: Iterable[Surface]) -> Surface:
    """A surface with the colours that the nearest points of others have; itself where none of them has any.

    Args:
        surface: what is coloured.
        sources: surfaces in the same place, such as those that it was made of.
    """
    from .distance_field import nearest  # brings Warp

    coloured = [other for other in sources if other.colours is not None]
    if not coloured:
        return surface
    before = np.cumsum([0, *(len(other.vertices) for other in coloured)])
    vertices = np.concatenate([other.vertices for other in coloured])
    faces = np.concatenate([other.faces + start for other, start in zip(coloured, before, strict=False)])
    ends = np.concatenate([vertices, surface.vertices])
    reach = float(np.linalg.norm(np.ptp(ends, axis=0)))
    face, weights = nearest(Surface(vertices, faces.astype(np.int32)), surface.vertices, reach)
    corners = np.concatenate([other.colours for other in coloured if other.colours is not None])[faces[face]]
    colours = np.einsum("nk,nkc->nc", weights, corners.astype(np.float64))
    return replace(surface, colours=np.rint(colours.clip(0.0, 255.0)).astype(np.uint8))


def coloured_from_points(surface: Surface, points: np.ndarray, colours: np.ndarray, reach: float) -> Surface:
    """A surface with the colours of the nearest points of a scan; their median where none is near.

    Args:
        surface: what is coloured.
        points: of the scan [mm], shape (n, 3).
        colours: uint8, shape (n, 3).
        reach: how far a point gives its colour [mm].
    """
    from scipy.spatial import KDTree  # heavy

    distance, nearest = KDTree(points).query(surface.vertices)
    nearest_colours = colours[np.asarray(nearest)]
    nearest_colours[np.asarray(distance) > reach] = np.median(colours, axis=0)
    return replace(surface, colours=nearest_colours)
