"""An image between its file and its voxels, and whether these lie where a patient can be."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from warp_trunk.errors import InputError


@dataclass(frozen=True, eq=False)
class Stored:
    """An image as its file stores it, before its voxels are converted."""

    slabs: Callable[[slice], np.ndarray]
    """Voxels of a range of the last axis, shape (i, j, n) or (layers, i, j, n)."""
    shape: tuple[int, ...]
    """(i, j, k), or (layers, i, j, k)."""
    affine: np.ndarray
    """From voxels to LPS [mm], shape (4, 4)."""
    names: tuple[Mapping[int, str], ...] = ({},)
    notes: tuple[str, ...] = ()


VOXEL = (0.1, 12.0)
"""How long the sides of a voxel may be [mm]."""
LARGEST = 2500.0
"""No scan of a patient reaches further than this along one axis of its grid [mm]."""
_SLANT = 0.7
"""Volume of a voxel over the product of its sides: 1 where they are at right angles. A tilted gantry of 30
degrees, more than any scanner's, gives 0.87."""


def check_grid(path: Path, shape: tuple[int, ...], affine: np.ndarray) -> None:
    """Check the affine of a file.

    Args:
        path: the file, for the message.
        shape: voxels along the three axes.
        affine: from voxels to patient axes [mm], shape (4, 4).

    Raises:
        InputError: an affine that is not finite or has no inverse, or voxels or a grid of a size that no scan has.
    """
    if min(shape) < 2:
        raise InputError(
            f"{path}: has {_times(shape)} voxels, and a label map needs 2 along each axis; give the whole"
        )
    matrix = affine[:3, :3]
    if not np.isfinite(affine).all():
        raise InputError(
            f"{path}: its affine must be finite, it is {affine[:3].round(3).tolist()}; write it again"
        )
    sides = np.linalg.norm(matrix, axis=0)
    low, high = VOXEL
    if not ((sides >= low) & (sides <= high)).all():
        raise InputError(
            f"{path}: voxels must be {low:g} to {high:g} mm long, these are {_times(sides)} mm; write "
            "the file with its spacing in mm, not in m, cm or micrometres"
        )
    if abs(np.linalg.det(matrix)) < _SLANT * sides.prod():
        raise InputError(
            f"{path}: the axes of its affine lie nearly in one plane ({matrix.round(3).tolist()}); write it again"
        )
    extent = sides * shape
    if extent.max() > LARGEST or np.abs(affine[:3, 3]).max() > 1e5:
        raise InputError(
            f"{path}: reaches over {_times(extent)} mm from {affine[:3, 3].round(1).tolist()}, and a scan over "
            f"{LARGEST:g} mm at most; look at its spacing and origin"
        )


def _times(numbers: np.ndarray | tuple[int, ...]) -> str:
    return " x ".join(f"{number:.4g}" for number in numbers)
