"""Where in an image one thing is: the box around it only, so that 45 bones fit into memory."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

_SAME_GRID = 0.1
"""Grids whose corners are nearer than this, in voxels, are one: headers round."""
_SLAB = 64
"""Layers that are grown at a time."""


@dataclass(frozen=True, eq=False)
class Mask:
    """The voxels of one label."""

    inside: np.ndarray
    """Whether each voxel of the box is of the label, shape (i, j, k), bool."""
    first: tuple[int, ...]
    """Number of the box's first voxel in the image."""
    affine: np.ndarray
    """From numbers of the image's voxels to LPS [mm], shape (4, 4)."""
    shape: tuple[int, ...]
    """Voxels of the whole image."""

    @property
    def spacing(self) -> np.ndarray:
        """Sides of a voxel [mm], shape (3,)."""
        return np.linalg.norm(self.affine[:3, :3], axis=0)

    @property
    def voxel_volume(self) -> float:
        """Of one voxel [mm3]."""
        return float(abs(np.linalg.det(self.affine[:3, :3])))

    def points(self) -> np.ndarray:
        """Centres of its voxels [mm], shape (n, 3)."""
        return self.place(np.argwhere(self.inside))

    def place(self, voxels: np.ndarray) -> np.ndarray:
        """Where voxels of the box (n, 3) are, by their numbers, which need not be whole [mm], shape (n, 3)."""
        return (voxels + np.array(self.first)) @ self.affine[:3, :3].T + self.affine[:3, 3]

    def corners(self, whole: bool = False) -> np.ndarray:
        """The corners of its box, or of the whole image [mm], shape (8, 3)."""
        low, size = (-np.array(self.first), self.shape) if whole else (np.zeros(3), self.inside.shape)
        return self.place(low + np.stack(np.meshgrid(*([0.0, 1.0],) * 3), axis=-1).reshape(-1, 3) * size - 0.5)

    def place_blocks(self, blocks: np.ndarray, factors: tuple[int, ...]) -> np.ndarray:
        """Where the middles of blocks of voxels (n, 3) are, by their numbers (`reduced`) [mm], shape (n, 3)."""
        return self.place(blocks * factors + 0.5 * (np.array(factors) - 1.0))

    def holds(self, points: np.ndarray) -> np.ndarray:
        """Whether points (..., 3) [mm] are more inside than outside, linear between the centres of voxels."""
        from scipy import ndimage  # heavy

        voxels = (points - self.place(np.zeros(3))) @ np.linalg.inv(self.affine[:3, :3]).T
        values, places = self.inside.view(np.uint8), np.moveaxis(voxels, -1, 0)
        return ndimage.map_coordinates(values, places, output=np.float32, order=1, mode="grid-constant") > 0.5

    def filled(self) -> Mask:
        """With what it encloses, as where it is a shell or leaves the bones out.

        At the ends of the image, which cut it open, it is closed within the outermost layers. Gaps of two voxels
        in the wall do not open it.
        """
        from scipy import ndimage  # heavy

        inside = self.inside.copy()
        for axis, side in self.faces_at_border():
            layer = inside[(slice(None),) * axis + (side * -1,)]
            layer[:] = ndimage.binary_fill_holes(layer)
        inside = np.pad(inside, 2)
        outside = _reached(np.asarray(ndimage.binary_dilation(inside)))
        for first in range(0, inside.shape[2], _SLAB):  # the whole at once would take an image's memory more
            low = max(first - 1, 0)
            grown: Any = ndimage.binary_dilation(outside[..., low : first + _SLAB + 1])
            slab = inside[..., first : first + _SLAB]
            slab |= ~grown[..., first - low :][..., : slab.shape[2]]
        return replace(self, inside=inside[2:-2, 2:-2, 2:-2])

    def part(self, inside: np.ndarray) -> Mask | None:
        """Some of its voxels, (i, j, k) of its box, in a box of their own; None where there are none."""
        box = boxes(inside.view(np.uint8)).get(1)
        if box is None:
            return None
        first = tuple(first + side.start for first, side in zip(self.first, box, strict=True))
        return replace(self, inside=inside[box].copy(), first=first)

    def faces_at_border(self) -> list[tuple[int, int]]:
        """The faces of the image on which it has voxels, by axis and side (0 low, 1 high)."""
        faces = [
            (axis, side, side * (self.shape[axis] - 1) - self.first[axis]) for axis in range(3) for side in (0, 1)
        ]
        held = self.inside
        return [(a, s) for a, s, at in faces if 0 <= at < held.shape[a] and held.take(at, axis=a).any()]


def joined_masks(first: Mask, other: Mask) -> Mask | None:
    """Both in one box; None where they are of different images."""
    if first.shape != other.shape:
        return None
    apart = np.abs(first.corners(whole=True) - other.corners(whole=True)).max()
    if apart > _SAME_GRID * first.spacing.min():
        return None
    low = np.minimum(first.first, other.first)
    high = np.maximum(np.add(first.first, first.inside.shape), np.add(other.first, other.inside.shape))
    inside = np.zeros(high - low, dtype=bool)
    for mask in (first, other):
        box = zip(mask.first - low, mask.inside.shape, strict=True)
        inside[tuple(slice(start, start + n) for start, n in box)] |= mask.inside
    return replace(first, inside=inside, first=tuple(low.tolist()))


def _reached(wall: np.ndarray) -> np.ndarray:
    """Which voxels the first one reaches around a wall, bool, shape (i, j, k), in place of the wall.

    Pieces of single layers are linked to those of the next: numbers for all voxels at once would take four times
    the memory of the image.
    """
    from scipy import ndimage  # heavy
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    def numbered(layer: int) -> tuple[np.ndarray, int]:
        pieces: Any = ndimage.label(~wall[..., layer])
        return pieces

    before, links, first = np.zeros(wall.shape[:2], dtype=np.int32), [], [0]
    for layer in range(wall.shape[2]):
        pieces, count = numbered(layer)
        pieces = np.where(pieces > 0, pieces + first[-1], 0)
        pairs = np.stack([before, pieces])[:, (pieces > 0) & (before > 0)]
        links.append(pairs[:, np.append(True, np.diff(pairs).any(axis=0))[: pairs.shape[1]]])
        first.append(first[-1] + count)
        before = pieces
    upper, lower = np.hstack(links)
    graph = coo_array((np.ones(len(upper), dtype=bool), (upper, lower)), shape=(first[-1] + 1, first[-1] + 1))
    part = connected_components(graph, directed=False)[1]
    open_part = part[1:] == part[1]
    for layer in range(wall.shape[2]):
        pieces, _ = numbered(layer)
        wall[..., layer] = np.append(False, open_part[first[layer] : first[layer + 1]])[pieces]
    return wall


def boxes(labels: np.ndarray) -> dict[int, tuple[slice, slice, slice]]:
    """The box around each label that is not 0, by its number; labels are whole numbers from 0, shape (i, j, k)."""
    from scipy import ndimage  # heavy

    slices = ndimage.find_objects(labels.T)  # images are stored with the first axis fastest
    return {value: box[::-1] for value, box in enumerate(slices, start=1) if box is not None}


def depth(inside: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """How far each voxel inside is from the nearest one outside, from centre to centre; 0 outside [mm]."""
    from scipy import ndimage  # heavy

    return np.asarray(ndimage.distance_transform_edt(inside, sampling=spacing), dtype=np.float32)


def distance(inside: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """How far each voxel is from the nearest one on the other side, negative inside [mm]."""
    return depth(~inside, spacing) - depth(inside, spacing)


def factors_below(side: float, spacing: np.ndarray) -> tuple[int, ...]:
    """How many voxels along each axis make a block whose sides stay below a length [mm]."""
    return tuple(max(1, int(side / voxel)) for voxel in spacing)


def reduced(inside: np.ndarray, factors: tuple[int, ...]) -> np.ndarray:
    """How full blocks of voxels are, 0 to 1, shape (ceil(i / factor), ...), float32."""
    padded = np.pad(inside, [(0, -n % f) for n, f in zip(inside.shape, factors, strict=True)])
    shape = [part for n, f in zip(padded.shape, factors, strict=True) for part in (n // f, f)]
    return padded.reshape(shape).sum(axis=(1, 3, 5), dtype=np.uint16).astype(np.float32) / np.prod(factors)
