"""Where in an image one thing is: the box around it only, so that 45 bones fit into memory."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from warp_trunk.geometry.distance_field import connected


@dataclass(frozen=True, eq=False)
class Mask:
    """The voxels of one label."""

    inside: np.ndarray
    """Whether each voxel of the box is of the label, shape (i, j, k), bool."""
    first: tuple[int, int, int]
    """Number of the box's first voxel in the image."""
    affine: np.ndarray
    """From numbers of the image's voxels to LPS [mm], shape (4, 4)."""
    shape: tuple[int, int, int]
    """Voxels of the whole image."""

    @property
    def spacing(self) -> np.ndarray:
        """Sides of a voxel [mm], shape (3,)."""
        return np.linalg.norm(self.affine[:3, :3], axis=0)

    @property
    def voxel_volume(self) -> float:
        """Of one voxel [mm3]."""
        return float(abs(np.linalg.det(self.affine[:3, :3])))

    @property
    def volume(self) -> float:
        """Of all voxels [mm3]."""
        return float(np.count_nonzero(self.inside)) * self.voxel_volume

    def points(self) -> np.ndarray:
        """Centres of its voxels [mm], shape (n, 3)."""
        return self.place(np.argwhere(self.inside))

    def place(self, voxels: np.ndarray) -> np.ndarray:
        """Where voxels of the box (n, 3) are, by their numbers, which need not be whole [mm], shape (n, 3)."""
        return (voxels + np.array(self.first)) @ self.affine[:3, :3].T + self.affine[:3, 3]

    def part(self, inside: np.ndarray) -> Mask | None:
        """Some of its voxels, (i, j, k) of its box, in a box of their own; None where there are none."""
        box = boxes(inside.view(np.uint8)).get(1)
        if box is None:
            return None
        i, j, k = (first + side.start for first, side in zip(self.first, box, strict=True))
        return replace(self, inside=inside[box].copy(), first=(i, j, k))

    def faces_at_border(self) -> dict[tuple[int, int], int]:
        """How many of its voxels lie on each face of the image, by axis and side (0 low, 1 high); none where
        none."""
        found = {}
        for axis in range(3):
            for side, at in ((0, 0), (1, self.shape[axis] - 1)):
                local = at - self.first[axis]
                if 0 <= local < self.inside.shape[axis]:
                    count = int(np.count_nonzero(self.inside.take(local, axis=axis)))
                    if count:
                        found[axis, side] = count
        return found


def joined(one: Mask, other: Mask) -> Mask | None:
    """Both in one box; None where they are of different images."""
    if one.shape != other.shape or not np.allclose(one.affine, other.affine, atol=1e-3):
        return None
    low = np.minimum(one.first, other.first)
    high = np.maximum(np.add(one.first, one.inside.shape), np.add(other.first, other.inside.shape))
    inside = np.zeros(high - low, dtype=bool)
    for mask in (one, other):
        start = mask.first - low
        box = tuple(slice(a, a + n) for a, n in zip(start, mask.inside.shape, strict=True))
        inside[box] |= mask.inside
    x, y, z = low.tolist()
    return Mask(inside, (x, y, z), one.affine, one.shape)


def boxes(labels: np.ndarray) -> dict[int, tuple[slice, slice, slice]]:
    """The box around each label that is not 0, by its number; labels are whole numbers from 0, shape (i, j, k)."""
    from scipy import ndimage  # heavy

    found = ndimage.find_objects(labels.T)  # images are stored with the first axis fastest
    return {value: box[::-1] for value, box in enumerate(found, start=1) if box is not None}


def largest_piece(inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The largest connected piece, also over edges and corners, and the sizes of all, largest first [voxels]."""
    pieces = connected(inside, diagonally=True)
    sizes = np.bincount(pieces.reshape(-1))
    sizes[0] = 0
    return pieces == sizes.argmax(), np.sort(sizes[sizes > 0])[::-1]


def depth(inside: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """How far each voxel inside is from the nearest one outside, from centre to centre; 0 outside [mm]."""
    from scipy import ndimage  # heavy

    return np.asarray(ndimage.distance_transform_edt(inside, sampling=spacing), dtype=np.float32)


def distance(inside: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """How far each voxel is from the nearest one on the other side, negative inside [mm]."""
    return depth(~inside, spacing) - depth(inside, spacing)


def reduced(inside: np.ndarray, factors: tuple[int, ...]) -> np.ndarray:
    """How full blocks of voxels are, 0 to 1, shape (ceil(i / factor), ...), float32."""
    if max(factors) == 1:
        return inside.astype(np.float32)
    whole = [-(-n // f) * f for n, f in zip(inside.shape, factors, strict=True)]
    padded = np.pad(inside, [(0, w - n) for w, n in zip(whole, inside.shape, strict=True)])
    shape = [part for w, f in zip(whole, factors, strict=True) for part in (w // f, f)]
    return padded.reshape(shape).sum(axis=(1, 3, 5), dtype=np.uint16).astype(np.float32) / np.prod(factors)
