"""Points without triangles, as scanners of the back write them, from a file by its ending."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.colours import as_colours

from .file_access import MOST_SURFACE, FormatError, check_file, number, parsing, read_bytes
from .surface_files.ply import ply_colours, ply_columns
from .surface_files.polygons import read_obj
from .surface_files.space import stated_space
from .surface_files.surface_reader import ENDINGS, cure_of, parse

_TEXT = (".xyz", ".csv", ".txt", ".asc", ".pts")
_SPLIT = re.compile(rb"[,;\s]+")


def read_points(path: str | Path) -> np.ndarray:
    """The points of a scan as `read_scan`, without their colours."""
    return read_scan(path)[0]


def read_scan(path: str | Path) -> tuple[np.ndarray, np.ndarray | None]:
    """The points of a scan, shape (n, 3) float64, in the numbers of the file; LPS where its
    header says SPACE=RAS. And their colours where it has some, shape (n, 3), uint8.

    Text holds x, y and z in the first three columns of each line, split by blanks, commas or semicolons, under at
    most one line of titles. Of a surface the vertices are taken, and the middles of its triangles; they have
    colours as `read_surface` has. Other columns of a text are passed over, and so are
    rows of a single number (the count of PTS) and points whose coordinates are all NaN (of organised clouds).

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
    surface = parse(ending, content, path)
    used, faces, colours = np.unique(surface.faces), surface.faces, surface.colours
    points = np.vstack([surface.vertices[used], surface.vertices[faces].mean(axis=1)])
    return points, None if colours is None else np.vstack([colours[used], colours[faces[:, 0]]])


def _table(content: bytes) -> np.ndarray:
    lines = [line for line in (raw.strip() for raw in content.splitlines()) if line and line[:1] not in b"#/"]
    rows = [_SPLIT.split(line)[:3] for line in lines]
    rows = [row for row in rows if not (len(row) == 1 and row[0].isdigit())]  # a PTS begins with a count
    if rows and not rows[0][0][:1].isdigit() and rows[0][0][:1] not in (b"-", b"+", b"."):
        rows = rows[1:]
    if not rows:
        raise FormatError("it holds no points")
    short = next((number for number, row in enumerate(rows, start=1) if len(row) < 3), None)
    if short:
        raise FormatError(f"row {short} has fewer than three numbers")
    return np.array([[number(word.decode()) for word in row] for row in rows])
