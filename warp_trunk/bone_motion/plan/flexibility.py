"""What films of side bending show: how much of a curve bends out, and how far each segment reaches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.measures.cobb import CobbAngle, curves_after, vertebral_tilt
from warp_trunk.measures.spine import spine_of

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.case.landmarks import Landmarks

BEYOND = 2.0
"""A segment may be asked for this much more than it showed: films are read no better [degrees]."""


def bending_films(case: Case) -> tuple[Landmarks, ...]:
    """The films of a case, left and right, as many as there are.

    Raises:
        InputError: they are exchanged: the spine leans further to the right on the film of bending to the left.
    """
    films = tuple(film for film in (case.bending_left, case.bending_right) if film is not None)
    if len(films) == 2:
        left, right = (np.nanmean(_tilt(film)) for film in films)
        if left < right:
            raise InputError(
                f"landmarks_bending_left: the vertebrae lean {right - left:.0f} degrees further to the right than "
                "in landmarks_bending_right; exchange the two files"
            )
    return films


def flexibility_of(curves: Sequence[CobbAngle], films: Sequence[Landmarks]) -> dict[str, float]:
    """The flexibility index of each curve by its apex: the share of its Cobb angle that bends out.

    (Cobb standing - Cobb bending) / Cobb standing, between the end vertebrae of standing, on the film where the
    curve is smallest. A curve whose end vertebrae no film shows has none.
    """
    found: dict[str, float] = {}
    bent = [curves_after(curves, film) for film in films]
    for number, curve in enumerate(curves):
        angles = [angle for film in bent if (angle := film[number]) is not None]
        if angles:
            found[curve.apex] = (curve.angle - min(angles)) / curve.angle
    return found


def beyond_reach(before: Landmarks, after: Landmarks, films: Sequence[Landmarks]) -> dict[str, float]:
    """Segments that a plan bends further in the coronal plane than any film shows, by how much [degrees].

    A segment is named by its two vertebrae, such as T8-T9; one that films do not show is left out.
    """
    if not films:
        return {}
    levels = before.vertebrae()
    bends = np.array([_bends(levels, marks) for marks in (before, *films)])
    known = np.isfinite(bends[1:]).any(axis=0)
    planned = _bends(levels, after)
    over = np.maximum(np.nanmin(bends, axis=0) - planned, planned - np.nanmax(bends, axis=0))
    return {
        f"{levels[row]}-{levels[row + 1]}": float(over[row]) for row in np.flatnonzero(known & (over > BEYOND))
    }


def _tilt(marks: Landmarks) -> np.ndarray:
    return vertebral_tilt(spine_of(marks).endplates)


def _bends(levels: Sequence[str], marks: Landmarks) -> np.ndarray:
    """Tilt of each vertebra less that of the one below [degrees], shape (levels - 1,); NaN where not seen."""
    spine = spine_of(marks)
    return -np.diff(vertebral_tilt(np.array([spine.endplates_of(level) for level in levels])))
