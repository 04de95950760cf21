"""Named points on bones, and the CSV file that holds them."""

from __future__ import annotations

import csv
import difflib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .errors import InputError

VERTEBRA_POINTS = (
    "superior_endplate",
    "inferior_endplate",
    "left_pedicle_superior",
    "left_pedicle_inferior",
    "right_pedicle_superior",
    "right_pedicle_inferior",
)
"""The six landmarks of a vertebra, in the order files are written."""

ASIS = {"asis_left": "hip_left", "asis_right": "hip_right"}
"""The anterior superior iliac spines, and the bone of each; their names do not begin with it."""

_HEADER = ["name", "x", "y", "z"]
_VERTEBRA = re.compile(r"([CTL])(\d+)_")


@dataclass(frozen=True, eq=False)
class Landmarks:
    """Points with names, `<bone>_<point>` (and `asis_left`, `asis_right`)."""

    names: tuple[str, ...]
    """One name for each point, none twice."""
    points: np.ndarray
    """Positions [mm], shape (n, 3), float64."""

    def __post_init__(self) -> None:
        """Raises InputError for a name given twice, or another number of names than of points."""
        if self.points.shape != (len(self.names), 3):
            raise InputError(
                f"landmarks: points must have shape ({len(self.names)}, 3), one for each name, "
                f"not {self.points.shape}"
            )
        twice = sorted({name for name in self.names if self.names.count(name) > 1})
        if twice:
            raise InputError(f"landmarks: '{twice[0]}' is named more than once; give each point its own name")

    def index(self, name: str) -> int:
        """The row of a landmark; InputError with the nearest name where there is none of that name."""
        if name not in self.names:
            near = difflib.get_close_matches(name, self.names, n=1)
            hint = f"; did you mean '{near[0]}'?" if near else ""
            raise InputError(f"landmarks: there is no '{name}' among the {len(self.names)} landmarks{hint}")
        return self.names.index(name)

    def point(self, name: str) -> np.ndarray:
        """Position of one landmark [mm], shape (3,); InputError as `index`."""
        return self.points[self.index(name)]

    def of_bone(self, bone: str) -> Landmarks:
        """The landmarks of one bone, in their order; none where the bone has none."""
        rows = [i for i, name in enumerate(self.names) if _belongs(name, bone)]
        return Landmarks(tuple(self.names[i] for i in rows), self.points[rows].reshape(-1, 3))

    def vertebrae(self) -> tuple[str, ...]:
        """Names of the vertebrae that have a landmark, top to bottom."""
        found = {match.groups() for match in map(_VERTEBRA.match, self.names) if match}
        return tuple(r + n for r, n in sorted(found, key=lambda v: ("CTL".index(v[0]), int(v[1]))))


def bone_of(name: str, bones: Iterable[str]) -> str | None:
    """The bone among `bones` that a landmark belongs to by its name; None where it is not among them."""
    return max((bone for bone in bones if _belongs(name, bone)), key=len, default=None)


def _belongs(name: str, bone: str) -> bool:
    return ASIS[name] == bone if name in ASIS else name.startswith(f"{bone}_")


def read_landmarks(path: str | Path) -> Landmarks:
    """Read a CSV file with the header `name,x,y,z`; the numbers are taken as they stand.

    Empty lines, and spaces around a field, are passed over.

    Raises:
        InputError: a missing or unreadable file, another header, a line that has not four fields, an empty
            name or one used twice, a coordinate that is not a finite number, or no landmark at all.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; a CSV file with the header name,x,y,z was expected")
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [[field.strip() for field in row] for row in csv.reader(file)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read ({error}); it must be CSV text in UTF-8") from error
    if not rows or rows[0] != _HEADER:
        found = ",".join(rows[0]) if rows else "an empty file"
        raise InputError(f"{path}: the first line must be name,x,y,z, not {found[:80]}")

    first_line: dict[str, int] = {}
    points = []
    for line, row in enumerate(rows[1:], start=2):
        if not any(row):
            continue
        where = f"{path}, line {line}"
        if len(row) != 4 or not row[0]:
            raise InputError(f"{where}: a landmark is name,x,y,z, not '{','.join(row)[:80]}'")
        name = row[0]
        if name in first_line:
            raise InputError(
                f"{where}: '{name}' stands in line {first_line[name]} already; give each landmark once"
            )
        first_line[name] = line
        points.append(
            [_coordinate(text, f"{where}: {axis} of '{name}'") for axis, text in zip("xyz", row[1:], strict=True)]
        )
    if not points:
        raise InputError(f"{path}: there is no landmark in it; a case needs six for each vertebra and the ASIS")
    return Landmarks(tuple(first_line), np.array(points, dtype=np.float64))


def _coordinate(text: str, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"{what} must be a number, not '{text[:40]}'") from None
    if not np.isfinite(value):
        raise InputError(f"{what} must be finite, not {text}; correct it or leave the landmark out")
    return value


def write_landmarks(path: str | Path, landmarks: Landmarks) -> None:
    """Write a CSV file that `read_landmarks` reads back to the last bit."""
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(_HEADER)
        for name, point in zip(landmarks.names, landmarks.points.tolist(), strict=True):
            writer.writerow([name, *map(repr, point)])
