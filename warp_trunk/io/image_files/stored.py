"""An image between its file and its voxels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np


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
