"""Landmarks in space from their places on two radiographs, and checks that both show the same landmarks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from warp_trunk.case.landmarks import Landmarks, read_rows
from warp_trunk.errors import InputError
from warp_trunk.io.atomic_write import csv_text, write_whole
from warp_trunk.io.file_access import FormatError, parsed_number, read_text

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
        rows = [[parsed_number(word) for word in row] for row in rows if row]
        if [len(row) for row in rows] != [4, 4, 4]:
            raise FormatError(f"3 by 4 are needed, its lines have {[len(row) for row in rows]}")
    except FormatError as error:
        raise InputError(f"{path}: cannot be read ({error}); write 3 lines of 4 numbers") from error
    matrix = np.array(rows)
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

    fit = least_squares(off, start, jac="cs", xtol=1e-12)  # a complex step: derivatives without differences
    return fit.x, fit.jac


@dataclass(frozen=True)
class Triangulation:
    """Landmarks in space, and how well they are known."""

    landmarks: Landmarks
    """Where the rays of both films come nearest to meeting, in LPS [mm]."""
    miss: np.ndarray
    """Distance of each landmark's projection from its place on each film [units of the films], (n, 2)."""
    uncertainty: np.ndarray
    """Standard deviation along x, y and z of each landmark [mm], shape (n, 3)."""
    noise: float
    """Standard deviation of a coordinate on a film that the uncertainty is for [units of the films]."""

    @property
    def error(self) -> np.ndarray:
        """Root mean square distance in space to expect of each landmark [mm], shape (n,)."""
        return np.linalg.norm(self.uncertainty, axis=1)


def triangulate(first: Film, second: Film, limit: float = 5.0, noise: float | None = None) -> Triangulation:
    """The points whose projections lie nearest to their places on both films, in least squares.

    Starts from the direct linear transformation (two equations of each film, scaled to distances in mm) and
    minimises the reprojection error. With two films four numbers give three, so that one of them is left to
    judge by: across the rays' common plane a landmark that is off shows itself, along it not. The noise is
    estimated from these left-over numbers of all landmarks.

    Args:
        first: a film, such as the postero-anterior one.
        second: a film of the same landmarks from another side.
        limit: reprojection error above which landmarks are refused [units of the films].
        noise: standard deviation of a coordinate on the films; estimated when left out.

    Raises:
        InputError: a landmark that is on one film only; landmarks that are behind a source, that look swapped
            or mismatched (an error above the limit, or left and right or top and bottom of a bone exchanged),
            or whose two rays do not cross.
    """
    if not (limit > 0.0 and (noise is None or noise >= 0.0)):
        limits = f"{limit} and {noise}"
        raise InputError(f"triangulate: 'limit' must be above 0 and 'noise' at least 0, not {limits}")
    names = _common_names(first, second)
    films = (first, second)
    places = [film.rows(names) for film in films]
    projections = [film.projection for film in films]
    crossings = [meeting_point(projections, [p[i] for p in places], name) for i, name in enumerate(names)]
    points = np.array([point for point, _ in crossings])
    miss = np.column_stack([_miss(film, points, place) for film, place in zip(films, places, strict=True)])
    for film in films:
        depth = points @ film.projection[2, :3] + film.projection[2, 3]
        behind = np.flatnonzero(np.sign(depth) != np.sign(np.median(depth)))
        if behind.size:
            which = f"{_named(names, behind)} would lie behind the source"
            raise InputError(
                f"{film.view}: {which}; these are mismatched, or the projection of this film is wrong"
            )
    _check_miss(films, names, miss, limit)
    _check_order(names, points)
    if noise is None:
        noise = math.sqrt(float(np.sum(miss**2)) / len(names))  # one number left over for each landmark
    spread = np.array([np.diag(np.linalg.inv(gradient.T @ gradient)) for _, gradient in crossings])
    return Triangulation(Landmarks(names, points), miss, noise * np.sqrt(spread), noise)


def _miss(film: Film, points: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Distances of the projections of points (n, 3) from their places on a film (n, 2), shape (n,)."""
    return np.linalg.norm(project(film.projection, points) - places, axis=1)


def write_triangulation(path: str | Path, made: Triangulation) -> None:
    """Write a CSV file that `read_landmarks` reads, with columns for the error on the films and in space."""
    rows = np.column_stack([made.landmarks.points, made.miss.max(axis=1), made.uncertainty])
    head = ("name", "x", "y", "z", "reprojection_error", "sd_x", "sd_y", "sd_z")
    named = ([name, *row] for name, row in zip(made.landmarks.names, rows.tolist(), strict=True))
    write_whole(Path(path), csv_text([head, *named]))


def _common_names(first: Film, second: Film) -> tuple[str, ...]:
    """The names of both films.

    Raises:
        InputError: a name that is on one film only.
    """
    for film, other in ((first, second), (second, first)):
        if missing := [name for name in film.names if name not in set(other.names)]:
            which = f"'{missing[0]}'{f' and {len(missing) - 1} more are' if missing[1:] else ' is'} missing"
            cure = "mark each landmark on both films, under one name"
            raise InputError(f"{other.view}: {which}, which {film.view} has; {cure}")
    return first.names


def _check_miss(films: tuple[Film, Film], names: tuple[str, ...], miss: np.ndarray, limit: float) -> None:
    """Raises InputError for landmarks that miss a film by more than the limit.

    Names two that fit when their places on one film are exchanged, where there are such.
    """
    miss = miss.max(axis=1)
    bad = np.flatnonzero(miss > limit)
    bad = bad[np.argsort(-miss[bad])]
    first, second = (film.rows(names) for film in films)
    for pair in (np.array(sorted(pair)) for pair in combinations(bad, 2)):
        exchanged = 0.0
        for row, other_row in (pair, pair[::-1]):
            places = (first[row], second[other_row])
            point = meeting_point([film.projection for film in films], places, names[row])[0][None]
            misses = [_miss(film, point, place[None])[0] for film, place in zip(films, places, strict=True)]
            exchanged = max(exchanged, *misses)
        if exchanged <= limit:
            first_name, other = (f"'{names[i]}'" for i in pair)
            what = f"{first_name} and {other} look swapped here or on {films[0].view}"
            by = f"{miss[pair[0]]:.1f} and {miss[pair[1]]:.1f}, exchanged by {exchanged:.1f}"
            raise InputError(f"{films[1].view}: {what}: they miss by {by}; correct their names")
    if bad.size:
        what = f"{_named(names, np.sort(bad))} cannot be the same on {films[0].view}"
        by = f"and miss by {miss[bad[0]]:.1f} where {limit:g} is allowed"
        raise InputError(f"{films[1].view}: {what}, {by}; mark them again, or check the projections")


def _check_order(names: tuple[str, ...], points: np.ndarray) -> None:
    """Raises InputError for a left landmark right of its right one, or a superior one below its inferior one.

    Heights on two films distinguish most landmarks; those of equal height are distinguished by their names.
    """
    for word, other, axis, side in (("left", "right", 0, "to the left of"), ("superior", "inferior", 2, "above")):
        for i, name in enumerate(names):
            twin = name.replace(word, other, 1)
            if (
                twin != name
                and twin in names
                and (off := points[names.index(twin), axis] - points[i, axis]) >= 0.0
            ):
                rule = f"'{name}' must lie {side} '{twin}' but lies {off:.1f} mm on the other side"
                cure = "correct their names on the films, or the projection, which must be in patient axes (LPS)"
                raise InputError(f"triangulate: {rule}; {cure}")


def _named(names: tuple[str, ...], rows: np.ndarray, most: int = 4) -> str:
    quoted = [f"'{names[row]}'" for row in rows]
    return ", ".join(quoted[:most]) + (f" and {len(quoted) - most} more" if len(quoted) > most else "")
