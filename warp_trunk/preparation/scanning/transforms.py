"""Rigid transforms that bring scans into one frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import FARTHEST, Surface
from warp_trunk.io.file_access import number, read_text

_OFF = 1e-3
"""A rotation may be this far from an exact one in any element: files with four decimals are."""


def read_transform(path: str | Path) -> np.ndarray:
    """Read a rigid transform: the 16 numbers of a 4x4 matrix row by row, blanks or commas between; mm.

    Returns the matrix with its rotation made exact, shape (4, 4).

    Raises InputError when the file is missing, does not hold 16 finite numbers, or when it scales or mirrors.
    """
    path = Path(path)
    words = read_text(path, "a transform of 16 numbers was expected").replace(",", " ").split()
    try:
        matrix = np.array([number(word) for word in words])
    except ValueError as error:
        raise InputError(
            f"{path}: must hold 16 numbers and nothing else ({str(error)[:80]}); give a 4x4 matrix"
        ) from error
    if len(matrix) != 16 or not (np.abs(matrix) <= FARTHEST).all():
        finite = int((np.abs(matrix) <= FARTHEST).sum())
        raise InputError(f"{path}: must hold 16 finite numbers, not {finite} of {len(matrix)}; give a 4x4 matrix")
    return rigid(matrix.reshape(4, 4), str(path))


def rigid(matrix: np.ndarray, name: str) -> np.ndarray:
    """The matrix (4, 4) with its rotation made exact.

    Raises InputError that starts with `name` when it is not a rotation and a translation.
    """
    if np.abs(matrix[3] - [0.0, 0.0, 0.0, 1.0]).max() > _OFF:
        raise InputError(
            f"{name}: the last row must be 0 0 0 1, not {matrix[3].tolist()}; write the matrix row by row"
        )
    left, stretch, right = np.linalg.svd(matrix[:3, :3])
    if np.linalg.det(matrix[:3, :3]) < 0.0:
        raise InputError(f"{name}: the transform mirrors (its determinant is negative); give a rotation")
    if np.abs(stretch - 1.0).max() > _OFF:
        raise InputError(
            f"{name}: the transform scales by {stretch.min():.6g} to {stretch.max():.6g}, and must not; scale the "
            "scan to mm first"
        )
    exact = matrix.copy()
    exact[:3, :3] = left @ right
    exact[3] = [0.0, 0.0, 0.0, 1.0]
    return exact


def moved(surface: Surface, matrix: np.ndarray) -> Surface:
    """The surface carried by a rigid transform (4, 4)."""
    return Surface(surface.vertices @ matrix[:3, :3].T + matrix[:3, 3], surface.faces)
