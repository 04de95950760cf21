"""Numbers on a grid of voxels, as scanners and segmentation programs write them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

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
    """What is doubtful in the file, a sentence each."""
