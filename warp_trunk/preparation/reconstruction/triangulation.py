"""Landmarks in space from their places on two radiographs, and checks that both show the same landmarks."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.io.atomic_write import atomic_write

from .films import Film, meeting_point, project


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
    if not limit > 0.0:
        raise InputError(f"triangulate: 'limit' must be above 0, not {limit}")
    if noise is not None and not noise >= 0.0:
        raise InputError(f"triangulate: 'noise' must be at least 0, not {noise}")
    names = common_names(first, second)
    films = (first, second)
    places = [film.rows(names) for film in films]
    projections = [film.projection for film in films]
    found = [meeting_point(projections, [p[i] for p in places], name) for i, name in enumerate(names)]
    points = np.array([point for point, _ in found])
    miss = np.column_stack(
        [np.linalg.norm(project(P, points) - p, axis=1) for P, p in zip(projections, places, strict=True)]
    )
    check_side(films, names, points)
    check_miss(films, names, miss, limit)
    check_order(names, points)
    if noise is None:
        noise = math.sqrt(float(np.sum(miss**2)) / len(names))  # one number left over for each landmark
    spread = np.array([np.diag(np.linalg.inv(gradient.T @ gradient)) for _, gradient in found])
    return Triangulation(Landmarks(names, points), miss, noise * np.sqrt(spread), noise)


def write_triangulation(path: str | Path, found: Triangulation) -> None:
    """Write a CSV file that `read_landmarks` reads, with columns for the error on the films and in space."""
    with atomic_write(Path(path)) as unfinished, unfinished.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["name", "x", "y", "z", "reprojection_error", "sd_x", "sd_y", "sd_z"])
        rows = np.column_stack([found.landmarks.points, found.miss.max(axis=1), found.uncertainty])
        for name, row in zip(found.landmarks.names, rows.tolist(), strict=True):
            writer.writerow([name, *map(repr, row)])


_SAID = (("left", "right", 0), ("superior", "inferior", 2))
"""Words of a landmark's name, and the axis along which the first lies further than the second."""


def common_names(first: Film, second: Film) -> tuple[str, ...]:
    """The names of both films.

    Raises:
        InputError: a name that is on one film only, or no landmark.
    """
    for film, other in ((first, second), (second, first)):
        missing = [name for name in film.names if name not in set(other.names)]
        if missing:
            more = f" and {len(missing) - 1} more are" if len(missing) > 1 else " is"
            raise InputError(
                f"{other.view}: '{missing[0]}'{more} missing, which {film.view} has; "
                "mark each landmark on both films, under one name"
            )
    if not first.names:
        raise InputError(f"{first.view}: there is no landmark on it; mark some on both films")
    return first.names


def check_side(films: tuple[Film, Film], names: tuple[str, ...], points: np.ndarray) -> None:
    """Raises InputError for landmarks on the other side of a source than most."""
    for film in films:
        depth = points @ film.projection[2, :3] + film.projection[2, 3]
        behind = np.sign(depth) != np.sign(np.median(depth))
        if behind.any():
            raise InputError(
                f"{film.view}: {_named(names, behind)} would lie behind the source; "
                "these are mismatched, or the projection of this film is wrong"
            )


def check_miss(films: tuple[Film, Film], names: tuple[str, ...], miss: np.ndarray, limit: float) -> None:
    """Raises InputError for landmarks that miss a film by more than the limit.

    Names two that fit when their places on one film are exchanged, where there are such.
    """
    bad = np.flatnonzero(miss.max(axis=1) > limit)
    bad = bad[np.argsort(-miss[bad].max(axis=1))]
    if not len(bad):
        return
    for n, i in enumerate(bad):
        for j in bad[n + 1 :]:
            left = _exchanged_miss(films, names, i, j)
            if left <= limit:
                pair = " and ".join(f"'{names[k]}'" for k in sorted((i, j)))
                raise InputError(
                    f"{films[1].view}: {pair} look swapped here or on {films[0].view}: they miss by "
                    f"{miss[i].max():.1f} and {miss[j].max():.1f}, exchanged by {left:.1f}; correct their names"
                )
    marked = np.isin(np.arange(len(names)), bad)
    raise InputError(
        f"{films[1].view}: {_named(names, marked)} cannot be the same on {films[0].view}, and miss by "
        f"{miss[bad[0]].max():.1f} where {limit:g} is allowed; mark them again, or check the projections"
    )


def _exchanged_miss(films: tuple[Film, Film], names: tuple[str, ...], i: int, j: int) -> float:
    """The largest reprojection error of two landmarks when their places on the second film are exchanged."""
    first, second = (film.rows(names) for film in films)
    projections = [film.projection for film in films]
    worst = 0.0
    for here, there in ((i, j), (j, i)):
        places = [first[here], second[there]]
        point = meeting_point(projections, places, names[here])[0][None]
        misses = [np.linalg.norm(project(P, point)[0] - p) for P, p in zip(projections, places, strict=True)]
        worst = max(worst, *(float(miss) for miss in misses))
    return worst


def check_order(names: tuple[str, ...], points: np.ndarray) -> None:
    """Raises InputError for a left landmark right of its right one, or a superior one below its inferior one.

    Heights on two films distinguish most landmarks; those of equal height are distinguished by their names.
    """
    for one, other, axis in _SAID:
        for i, name in enumerate(names):
            twin = name.replace(one, other, 1)
            if twin != name and twin in names and points[i, axis] <= points[names.index(twin), axis]:
                side = ("to the left of", "", "above")[axis]
                raise InputError(
                    f"triangulate: '{name}' must lie {side} '{twin}' but lies "
                    f"{points[names.index(twin), axis] - points[i, axis]:.1f} mm on the other side; "
                    "these are swapped on a film, or its projection is not in patient axes (LPS)"
                )


def _named(names: tuple[str, ...], which: np.ndarray, most: int = 4) -> str:
    found = [f"'{name}'" for name, marked in zip(names, which, strict=True) if marked]
    return ", ".join(found[:most]) + (f" and {len(found) - most} more" if len(found) > most else "")
