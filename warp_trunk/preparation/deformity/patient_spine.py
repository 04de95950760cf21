"""The spine of a patient as it was given: a line, or points of its vertebrae."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.case.landmarks import VERTEBRA_POINTS, Landmarks, read_landmarks
from warp_trunk.checking import Array, check_fields
from warp_trunk.errors import InputError
from warp_trunk.io.file_access import read_text
from warp_trunk.io.point_files import read_points

FEWEST_POINTS = 6
"""Points that a line needs."""
FEWEST_LEVELS = 8
"""Levels in a row down to L5 that a table of vertebrae needs."""


@dataclass(frozen=True, eq=False)
class PatientSpine:
    """A spine in the frame of the scan: a line, or points of vertebrae.

    >>> wt.PatientSpine("line", case.landmarks_before.middles()).levels
    ()
    """

    kind: Literal["line", "pedicles", "landmarks"]
    """The form of the data."""
    line: Annotated[np.ndarray, Array(None, 3)]
    """Through the middles of the vertebral bodies from top to bottom [mm], shape (n, 3)."""
    levels: tuple[str, ...] = ()
    """The vertebrae whose middles the points of the line are; none of a mere line."""
    up: Annotated[np.ndarray, Array(None, 3)] | None = None
    """Axis of each of these vertebrae, shape (levels, 3), where both endplates are known."""
    across: Annotated[np.ndarray, Array(None, 3)] | None = None
    """From the right to the left pedicle of each [mm], shape (levels, 3), where they are known."""

    def __post_init__(self) -> None:
        """Raises InputError for a field of another type or shape."""
        check_fields(self, "spine")


def read_patient_spine(path: str | Path, size: float = 1.0) -> PatientSpine:
    """Read a line (x,y,z), a table of bodies and pedicles (`T4_body`, `T4_left_pedicle`), or landmarks of films.

    Args:
        path: a CSV; points of a line from the top to the bottom.
        size: mm in a unit of the file.

    Raises:
        InputError: a file that cannot be read, too few points or levels, or a spine that runs upwards.
    """
    path = Path(path)
    titles = read_text(path, "a line (x,y,z) or named points (name,x,y,z) of the spine were expected")[:200]
    if "name" not in titles.split("\n")[0].lower() and path.suffix.lower() not in (".json", ".fcsv"):
        return spine_line(read_points(path, size), str(path))
    marks = read_landmarks(path)
    return spine_of_marks(Landmarks(marks.names, marks.points * size), str(path))


def spine_line(points: np.ndarray, what: str = "spine") -> PatientSpine:
    """A spine of which only the line through the bodies is known, shape (n, 3) [mm], the highest point first.

    Raises:
        InputError: fewer than 6 points, or a line that does not run down.
    """
    if len(points) < FEWEST_POINTS:
        raise InputError(f"{what}: a line needs {FEWEST_POINTS} points, and has {len(points)}; give more of them")
    _check_down(points, what)
    return PatientSpine("line", points)


def spine_of_marks(marks: Landmarks, what: str = "spine") -> PatientSpine:
    """A spine from landmarks of its vertebrae: body and pedicles, or the six points of a case.

    Raises:
        InputError: levels that are no row of 8 or more down to L5, a missing point, or a spine that runs upwards.
    """
    levels = [level for level in VERTEBRAE if any(name.startswith(f"{level}_") for name in marks.names)]
    if len(levels) < FEWEST_LEVELS or tuple(levels) != VERTEBRAE[-len(levels) :]:
        rule = f"needs {FEWEST_LEVELS} or more levels in a row down to L5, and has {', '.join(levels) or 'none'}"
        raise InputError(f"{what}: {rule}; give their points")
    six = f"{levels[0]}_{VERTEBRA_POINTS[0]}" in marks.names
    parts = VERTEBRA_POINTS if six else ("body", "left_pedicle", "right_pedicle")
    for name in (f"{level}_{part}" for level in levels for part in parts):
        if name not in marks.names:
            raise InputError(f"{what}: '{name}' is missing; each level needs {', '.join(parts)}")
    table = np.array([[marks.point(f"{level}_{part}") for part in parts] for level in levels])
    at = {part: table[:, column] for column, part in enumerate(parts)}
    if six:
        top, bottom = at["superior_endplate"], at["inferior_endplate"]
        left, right = (at[f"{s}_pedicle_superior"] + at[f"{s}_pedicle_inferior"] for s in ("left", "right"))
        spine = PatientSpine("landmarks", (top + bottom) / 2.0, tuple(levels), top - bottom, (left - right) / 2.0)
    else:
        spine = PatientSpine("pedicles", at["body"], tuple(levels), None, at["left_pedicle"] - at["right_pedicle"])
    _check_down(spine.line, what)
    if spine.across is not None and not (spine.across[:, 0] > 0.0).all():
        level = levels[int(spine.across[:, 0].argmin())]
        cure = "exchange the names, or turn the axes to LPS"
        raise InputError(f"{what}: the left pedicle of {level} must lie left (+x) of the right one; {cure}")
    return spine


def _check_down(points: np.ndarray, what: str) -> None:
    way = float(points[0, 2] - points[-1, 2])
    if way <= 0.0:
        cure = "give the highest point first"
        raise InputError(f"{what}: runs the other way, upwards by {-way:.0f} mm; {cure}, in LPS axes with +z up")
    if not 100.0 <= way <= 700.0:
        raise InputError(f"{what}: must run down by 100 to 700 mm, and runs {way:.4g} mm; give it in mm")
    rise = float(np.diff(points[:, 2]).max())
    if rise > 3.0:
        raise InputError(f"{what}: must run down, and rises by {rise:.0f} mm between two points; sort them")
