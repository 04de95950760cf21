"""Points without triangles, as scanners of the back write them, from a file by its ending."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.colours import as_colours

from .file_access import MOST_SURFACE, FormatError, check_file, parsed_number, parsing, read_bytes
from .surface_files.ply import ply_colours, ply_columns
from .surface_files.polygons import read_obj
from .surface_files.space import stated_space
from .surface_files.surface_reader import ENDINGS, cure_of, in_unit, parse_surface

_TEXT = (".xyz", ".csv", ".txt", ".asc", ".pts")


def read_points(path: str | Path, size: float = 1.0) -> np.ndarray:
    """The points of a scan as `read_back`, without their colours."""
    return read_back(path, size)[0]


def read_back(path: str | Path, size: float = 1.0) -> tuple[np.ndarray, np.ndarray | None]:
    """The points of a scan in mm, shape (n, 3) float64; LPS where its header says SPACE=RAS. And their colours
    where it has some, shape (n, 3), uint8.

    Text holds x, y and z in the columns that its titles name, or in the first three, split by blanks, commas or
    semicolons; decimal commas are read where something else splits the columns. Other columns are passed over, and
    so are rows of a single number (the count of PTS) and points whose coordinates are all NaN (of organised
    clouds). Of a surface the vertices are taken, and the middles of its triangles; they have colours as
    `read_surface` has.

    Args:
        path: of the file.
        size: mm in its unit; a GLB in metres states its own.

    Raises:
        InputError: the file is missing, too large or cannot be read, or a number is not finite.
    """
    path = Path(path)
    kinds = ", ".join(sorted({*ENDINGS, *_TEXT}))
    ending, expected = path.suffix.lower(), f"a file of points or a surface ({kinds}) was expected"
    if ending not in ENDINGS and ending not in _TEXT:
        check_file(path, expected, MOST_SURFACE)
        raise InputError(f"{path}: cannot be read as points ('{ending}' is not known); {cure_of(ending, kinds)}")
    content = read_bytes(path, expected, MOST_SURFACE)
    with parsing(path, "points", len(content)):
        points, colours = _parsed(ending, content, path)
        if ending in ENDINGS and stated_space(ending, content) == "RAS":
            points *= (-1.0, -1.0, 1.0)
    points = size * in_unit(ending, points, size)
    seen = ~np.isnan(points).all(axis=1)  # organised clouds have a row of NaN for each pixel without a point
    points, colours = points[seen], None if colours is None else colours[seen]
    if not len(points):
        raise InputError(f"{path}: it holds no points; {expected}")
    bad = np.flatnonzero(~(np.isfinite(points).all(axis=1) & (np.abs(points).max(axis=1, initial=0.0) < 1e7)))
    if len(bad):
        raise InputError(f"{path}: point {bad[0]} is {points[bad[0]]}, not three finite numbers; remove it")
    return points, colours


def _parsed(ending: str, content: bytes, path: Path) -> tuple[np.ndarray, np.ndarray | None]:
    if ending in _TEXT:
        return _table(content), None
    if ending == ".ply":
        columns = ply_columns(content)
        if not columns.get("face"):
            vertex = columns["vertex"]
            points = np.column_stack([vertex[axis][0] for axis in "xyz"]).astype(np.float64)
            numbers = ply_colours(columns)
            return points, None if numbers is None else as_colours(numbers, points)
    if ending == ".obj" and not re.search(rb"^f\s", content, re.MULTILINE):
        points, _, numbers = read_obj(content)
        return points, None if numbers is None else as_colours(numbers, points)
    surface = parse_surface(ending, content, path)
    used, faces, colours = np.unique(surface.faces), surface.faces, surface.colours
    points = np.vstack([surface.vertices[used], surface.vertices[faces].mean(axis=1)])
    return points, None if colours is None else np.vstack([colours[used], colours[faces[:, 0]]])


def _table(content: bytes) -> np.ndarray:
    """The points of a text, from the columns called x, y and z, or from the first three."""
    wide = content[:2] in (b"\xff\xfe", b"\xfe\xff")  # as some editors and Excel write text
    text = content.decode("utf-16" if wide else "utf-8-sig", errors="replace")
    lines = [line for line in (raw.strip() for raw in text.splitlines()) if line]
    rows = [line for line in lines if line[0] not in "#/"]
    first = rows[0] if rows and not _NUMERIC.match(rows[0]) else None
    titles = [line for line in lines[: lines.index(rows[0])] if line[0] in "#/"] if rows else []
    if first is not None:
        titles, rows = [*titles, first], rows[1:]
    mark = _mark(rows)
    table = [_cells(row, mark) for row in rows]
    table = [row for row in table if not (len(row) == 1 and row[0].isdigit())]  # a PTS begins with a count
    if not table:
        raise FormatError("it holds no points")
    titles = [_UNIT.sub("", line.strip("#/ ")) for line in titles]
    columns = _columns([_cells(line, mark) if mark and mark in line else _ANY.split(line) for line in titles])
    short = next((number for number, row in enumerate(table, start=1) if len(row) <= max(columns)), None)
    if short:
        raise FormatError(f"row {short} has fewer than three numbers, or lacks x, y or z")
    return np.array([[parsed_number(row[column]) for column in columns] for row in table])


_NUMERIC = re.compile(r"[-+.,]?\d|[-+]?(?:nan|inf)\b", re.IGNORECASE)
"""How a line of numbers begins."""
_ANY = re.compile(r"[,;\s]+")
_UNIT = re.compile(r"[\[(][^\])]*[\])]|_mm\b", re.IGNORECASE)
"""The unit of a column in its title."""
_OF_PARAVIEW = {f"points{mark}{number}": axis for mark in ":_" for number, axis in enumerate("xyz")}
"""The columns of a table that ParaView exports."""
_BLANKS = re.compile(r"\d\s+[-+.]?\d")


def _mark(rows: list[str]) -> str | None:
    """The mark that splits the rows of a table: a semicolon, a tab or a comma; None for blanks."""
    some = rows[:: max(1, len(rows) // 100)]
    mark = next((mark for mark in ";\t" if any(mark in row for row in some)), None)
    return mark or (None if any(_BLANKS.search(row) for row in some) else ",")


def _cells(row: str, mark: str | None) -> list[str]:
    if mark is None:
        return [word.strip(",") for word in row.split()]
    return [cell.strip() for cell in next(csv.reader([row], delimiter=mark, skipinitialspace=True))]


def _columns(titles: list[list[str]]) -> tuple[int, int, int]:
    """The columns of x, y and z; the first three where no line of titles names one of them."""
    for words in titles:
        names = [word.lower() for word in words]
        names = [_OF_PARAVIEW.get(name, name) for name in names]
        at = [names.index(axis) if names.count(axis) == 1 else -1 for axis in "xyz"]
        if min(at) >= 0:
            return at[0], at[1], at[2]
        if names and names[0] in "xyz" and len(names) >= 3:
            missing = ", ".join(axis for axis, column in zip("xyz", at, strict=True) if column < 0)
            raise FormatError(
                f"its titles are {','.join(words)[:60]}, and {missing} is missing; name x, y and z once"
            )
    return 0, 1, 2
