"""The winding number of open, overlapping sheets, as a field on a grid.

Our own, because Warp returns only the side on which a point lies, and the skin is drawn from the values of the
field.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from warp_trunk.geometry.distance_field import Grid
from warp_trunk.geometry.surface import Surface, area_vectors, side_lengths


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
