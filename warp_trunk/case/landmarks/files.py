"""Reading landmarks from any file that holds them."""

from __future__ import annotations

from pathlib import Path

from warp_trunk.errors import InputError

from ..axes import Axes
from .landmarks import Landmarks
from .slicer import read_fcsv, read_markups
from .table import COLUMNS, read_table

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
