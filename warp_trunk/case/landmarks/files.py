"""Reading and writing landmarks: CSV tables, and any file that holds landmarks."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import FARTHEST
from warp_trunk.io.file_access import is_plain, number, read_text

from ..axes import Axes
from .landmarks import Landmarks
from .slicer import read_fcsv, read_markups

COLUMNS = ("name", "x", "y", "z")
"""The columns of a table of landmarks, unless others are named."""


def read_table(path: Path, columns: tuple[str, ...] = COLUMNS) -> Landmarks:
    """Landmarks from the columns of a CSV file; see `read_rows`."""
    return Landmarks(*read_rows(path, columns))


def read_rows(path: Path, columns: tuple[str, ...]) -> tuple[tuple[str, ...], np.ndarray]:
    """Names and numbers, shape (n, columns - 1), from the columns of a CSV file, as they stand.

    Empty lines, spaces around a field, and columns that are not named are passed over.

    Args:
        path: the file, which begins with the names of its columns.
        columns: which of them hold the landmark's name and its coordinates.

    Raises:
        InputError: an unreadable file, a header without these columns, a line with another number of fields,
            an empty name or one used twice, a coordinate that is not a finite number, or no landmark at all.
    """
    text = read_text(path, f"a table is given as CSV ({','.join(columns)}) in UTF-8")
    try:
        rows = [[field.strip() for field in row] for row in csv.reader(io.StringIO(text, newline=""))]
    except csv.Error as error:
        raise InputError(f"{path}: cannot be read ({error}); it must be CSV text in UTF-8") from error
    header = rows[0] if rows else []
    if any(header.count(column) != 1 for column in columns):
        found = ",".join(header) if header else "an empty file"
        raise InputError(
            f"{path}: the first line must name the columns {','.join(columns)} once each, not {found[:80]}; "
            "correct it, or name the columns of the file in case.toml as landmark_columns"
        )
    places = [header.index(column) for column in columns]

    first_line: dict[str, int] = {}
    points = []
    for line, row in enumerate(rows[1:], start=2):
        if not any(row):
            continue
        where = f"{path}, line {line}"
        if len(row) != len(header) or not row[places[0]]:
            raise InputError(f"{where}: a landmark is {','.join(header)}, not '{','.join(row)[:80]}'")
        name, *coordinates = (row[place] for place in places)
        if not is_plain(name):
            raise InputError(
                f"{where}: a name has no line breaks or control characters, not '{name[:40]}'; rename it"
            )
        if name in first_line:
            raise InputError(
                f"{where}: '{name}' stands in line {first_line[name]} already; give each landmark once"
            )
        first_line[name] = line
        points.append(
            [
                _coordinate(text, f"{where}: {axis} of '{name}'")
                for axis, text in zip(columns[1:], coordinates, strict=True)
            ]
        )
    if not points:
        raise InputError(f"{path}: there is no landmark in it; a case needs six for each vertebra and the ASIS")
    return tuple(first_line), np.array(points, dtype=np.float64)


def _coordinate(text: str, what: str) -> float:
    try:
        value = number(text)
    except ValueError:
        raise InputError(f"{what} must be a number, not '{text[:40]}'") from None
    if not abs(value) <= FARTHEST:  # nor is NaN
        raise InputError(
            f"{what} must be finite and within {FARTHEST:g}, not {text[:40]}; correct it or leave the landmark out"
        )
    return value


def write_landmarks(path: str | Path, landmarks: Landmarks) -> None:
    """Write a CSV file that `read_landmarks` reads back to the last bit."""
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for name, point in zip(landmarks.names, landmarks.points.tolist(), strict=True):
            writer.writerow([name, *map(repr, point)])


ENDINGS = (".csv", ".mrk.json", ".fcsv")
"""Endings of the files that are read."""


def read_landmarks(
    path: str | Path, axes: Axes | None = None, units: str = "mm", columns: tuple[str, ...] = COLUMNS
) -> Landmarks:
    """Landmarks in LPS and mm from a CSV table, or from the markups of 3D Slicer (.mrk.json, .fcsv).

    A file of 3D Slicer says itself in which axes and units it is; of a table, the caller has to.

    Args:
        path: the file; its ending says what it is.
        axes: those of a table; LPS when left out.
        units: of a table: mm, cm or m.
        columns: the columns of a table that hold name, x, y and z.

    Raises:
        InputError: a missing or unreadable file, a landmark that is named twice or not at all, a coordinate
            that is not a finite number, or no landmark.
    """
    path = Path(path)
    name = path.name.lower()
    if name.endswith(".mrk.json"):
        return read_markups(path)
    if name.endswith(".fcsv"):
        return read_fcsv(path)
    table = read_table(path, columns)
    return Landmarks(table.names, (axes or Axes("LPS")).points_to_lps(table.points, units))


def landmark_file(folder: Path, stem: str) -> Path:
    """The file of a folder that holds landmarks under this name; its CSV name where there is none.

    Raises:
        InputError: there is more than one.
    """
    found = [folder / (stem + ending) for ending in ENDINGS if (folder / (stem + ending)).is_file()]
    if len(found) > 1:
        raise InputError(
            f"{found[1]}: there is {found[0].name} beside it; give '{stem}' in one file and remove the other"
        )
    return found[0] if found else folder / f"{stem}.csv"
