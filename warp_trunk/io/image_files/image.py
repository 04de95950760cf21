"""An image as its file stores it, and as it is read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, eq=False)
class Image:
    """A scan, or the labels of one."""

    layers: np.ndarray
    """Values, shape (layers, i, j, k); whole numbers. Only segments that overlap need more than one layer."""
    affine: np.ndarray
    """Takes the number of a voxel to its centre in LPS [mm], shape (4, 4)."""
    names: tuple[Mapping[int, str], ...]
    """For each layer, what its labels are called in the file; empty where the file names none."""
    notes: tuple[str, ...] = ()
    """A sentence for each doubt about the file."""
    meanings: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
    """For a label, what its codes in the file say it is, where the file has codes."""


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
    meanings: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
