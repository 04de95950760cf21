"""Files of rigid transforms: a matrix as text, or an ITK transform."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import FARTHEST

from .file_access import FormatError, numbers, read_text

_ITK = "#Insight Transform File"
_AFFINE = ("AffineTransform_", "MatrixOffsetTransformBase_")
_OFF = 1e-3
"""A rotation may be this far from an exact one in any element: files with four decimals are."""


def read_transform(path: str | Path, axes: np.ndarray | None = None) -> np.ndarray:
    """Read a rigid transform: the 16 numbers of a 4x4 matrix row by row, blanks or commas between; mm.

    A file of ITK (.tfm, as 3D Slicer writes it) is read too. ITK transforms lead from where something is after to
    where it was before, in LPS and mm (ITK Software Guide, "Transforms"): what is returned is the inverse.

    Args:
        path: the file.
        axes: of a matrix, M with p_LPS = M p, shape (3, 3); an ITK file is in LPS. Those of LPS when left out.

    Returns the matrix with its rotation made exact, shape (4, 4).

    Raises InputError when the file is missing, does not hold 16 finite numbers, or when it scales or mirrors.
    """
    path = Path(path)
    text = read_text(path, "a transform of 16 numbers was expected")
    change = np.eye(4)
    if text.startswith(_ITK):
        return np.linalg.inv(rigid(_itk_matrix(text, str(path)), str(path)))
    change[:3, :3] = np.eye(3) if axes is None else axes
    words = text.replace(",", " ").split()
    try:
        matrix = numbers(words)
        if len(matrix) != 16:
            raise FormatError(f"there are {len(matrix)}")
    except FormatError as error:
        raise InputError(f"{path}: must hold 16 numbers and nothing else ({error}); give a 4x4 matrix") from error
    return change @ rigid(matrix.reshape(4, 4), str(path)) @ change.T


def _itk_matrix(text: str, name: str) -> np.ndarray:
    """The matrix (4, 4) of an ITK text transform: p goes to A (p - c) + t + c."""
    lines = [line.partition(":") for line in text.splitlines() if ":" in line and not line.startswith("#")]
    entries = {key.strip(): value.split() for key, _, value in lines}
    kinds = [value.strip() for key, _, value in lines if key.strip() == "Transform"]
    if len(kinds) != 1 or not kinds[0].startswith(_AFFINE):
        raise InputError(
            f"{name}: holds {', '.join(kinds) or 'no transform'}, and must hold a single one of "
            f"{' or '.join(_AFFINE)}; harden it into a linear transform and save it as .tfm"
        )
    parameters, fixed = entries.get("Parameters", []), entries.get("FixedParameters", ["0"] * 3)
    try:
        if (len(parameters), len(fixed)) != (12, 3):
            raise FormatError(f"there are {len(parameters)} and {len(fixed)}")
        values, centre = numbers(parameters), numbers(fixed)
    except FormatError as error:
        raise InputError(
            f"{name}: must hold 12 Parameters and 3 FixedParameters ({error}); save the transform again"
        ) from error
    matrix = np.eye(4)
    matrix[:3, :3] = values[:9].reshape(3, 3)
    matrix[:3, 3] = values[9:] + centre - matrix[:3, :3] @ centre
    return matrix


def rigid(matrix: np.ndarray, name: str) -> np.ndarray:
    """The matrix (4, 4) with its rotation made exact.

    Raises InputError that starts with `name` when it is not a rotation and a translation.
    """
    odd = matrix[~(np.abs(matrix) <= FARTHEST)]  # NaN, too
    if odd.size:
        raise InputError(f"{name}: must hold numbers within {FARTHEST:g}, not {odd[0]:g}; write it again")
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
