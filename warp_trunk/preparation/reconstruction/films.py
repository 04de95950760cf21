"""A radiograph: where landmarks lie on it, how it was taken, and where the rays of several meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from warp_trunk.case.landmarks.files import read_rows
from warp_trunk.errors import InputError
from warp_trunk.io.file_access import number, read_text

_COLUMNS = ("name", "u", "v")
_LARGEST = 1e100
"""No element of a projection is larger; squares of larger ones would not be finite."""


@dataclass(frozen=True, eq=False)
class Film:
    """Landmarks on one radiograph, whose source and place are calibrated."""

    view: str
    """Its name in an error, such as its file."""
    names: tuple[str, ...]
    """One name for each landmark, none twice."""
    points: np.ndarray
    """Their places on the film [mm, or pixels], shape (n, 2), float64."""
    projection: np.ndarray
    """P, shape (3, 4): a point X [mm, LPS] is seen at (p0, p1) / p2, where p = P (X, 1)."""

    def __post_init__(self) -> None:
        """Raises InputError for a projection without one source."""
        check_projection(self.view, self.projection)

    def rows(self, names: tuple[str, ...]) -> np.ndarray:
        """Places of these landmarks in their order, shape (n, 2)."""
        return self.points[[self.names.index(name) for name in names]]


def read_film(points: str | Path, projection: str | Path) -> Film:
    """A film from a CSV file with the columns name, u and v, and a text file with its matrix.

    Raises:
        InputError: a file that is missing, cannot be read or breaks a rule.
    """
    names, places = read_rows(Path(points), _COLUMNS)
    return Film(str(points), names, places, read_projection(projection))


def read_projection(path: str | Path) -> np.ndarray:
    """The projection matrix, shape (3, 4), of a text file with three lines of four numbers.

    Raises:
        InputError: a missing file, other than 3 by 4 finite numbers, or a matrix that is no projection from
            one source.
    """
    path = Path(path)
    text = read_text(path, "a projection is a text file of 3 lines of 4 numbers")
    try:
        rows = [line.split("#")[0].replace(",", " ").split() for line in text.split("\n")]
        matrix = np.array([[number(word) for word in row] for row in rows if row])
    except ValueError as error:
        raise InputError(f"{path}: cannot be read ({str(error)[:80]}); write 3 lines of 4 numbers") from error
    check_projection(str(path), matrix)
    return matrix


def check_projection(where: str, matrix: np.ndarray) -> None:
    """Raises InputError, which begins with `where`, for a matrix that is no projection from one source."""
    if matrix.shape != (3, 4) or not (np.abs(matrix) <= _LARGEST).all():
        raise InputError(f"{where}: a projection is 3 by 4 finite numbers, not {matrix.shape}; calibrate again")
    spread = np.linalg.svd(matrix[:, :3] / np.linalg.norm(matrix[:, :3], axis=1, keepdims=True).clip(1e-300))[1]
    if not spread[2] > 1e-9 * spread[0]:
        rule = "the first three columns must be a regular matrix, so that there is one source"
        raise InputError(f"{where}: {rule}; calibrate again")


def project(projection: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Where points (n, 3) [mm] are seen on a film, shape (n, 2)."""
    p = points @ projection[:, :3].T + projection[:, 3]
    return p[:, :2] / p[:, 2:]


_PARALLEL = 1e-4
"""Sine of the angle between rays below which they do not meet in one place."""


def meeting_point(
    projections: Sequence[np.ndarray], places: Sequence[np.ndarray], name: str
) -> tuple[np.ndarray, np.ndarray]:
    """The point whose projections lie nearest to the places, in least squares.

    Starts from the direct linear transformation: u p2 - p0 = 0 and v p2 - p1 = 0 are planes through the source
    that hold the point. They are normalised, so that what is left over are distances from them in mm.

    Args:
        projections: of each film, shape (3, 4).
        places: of the landmark on each film, shape (2,).
        name: of the landmark, for the error.

    Returns:
        The point [mm], shape (3,), and how its places on the films change with it, shape (2 films, 3).

    Raises:
        InputError: rays that are parallel, or meet in a source.
    """
    from scipy.optimize import least_squares  # heavy

    planes = np.vstack([place[:, None] * P[2] - P[:2] for P, place in zip(projections, places, strict=True)])
    planes /= np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    start, _, _, spread = np.linalg.lstsq(planes[:, :3], -planes[:, 3])
    if not spread[2] > _PARALLEL * spread[0]:
        raise InputError(f"triangulate: the rays of '{name}' are parallel; take the films from different sides")
    if any(abs(P[2] @ [*start, 1.0]) <= _PARALLEL * np.abs(P[2] * [*start, 1.0]).max() for P in projections):
        raise InputError(f"triangulate: the rays of '{name}' meet in a source; give each film its own projection")

    def off(X: np.ndarray) -> np.ndarray:
        return np.concatenate([project(P, X[None])[0] - p for P, p in zip(projections, places, strict=True)])

    found = least_squares(off, start, jac="cs", xtol=1e-12)  # a complex step: derivatives without differences
    return found.x, found.jac
