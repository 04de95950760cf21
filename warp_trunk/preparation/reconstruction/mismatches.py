"""Landmarks that are inconsistent between two films, and those whose names look exchanged."""

from __future__ import annotations

import numpy as np

from warp_trunk.errors import InputError

from .films import Film, project
from .rays import meeting_point

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
