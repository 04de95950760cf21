"""Points without triangles, as scanners of the back write them, from a file by its ending."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from warp_trunk.errors import InputError

from .file_access import MOST_SURFACE, limited_memory, number, read_bytes, reason
from .surface_files.ply import ply_columns
from .surface_files.space import stated_space
from .surface_files.surface_reader import ENDINGS, parse

_TEXT = (".xyz", ".csv", ".txt", ".asc", ".pts")
_SPLIT = re.compile(rb"[,;\s]+")


def read_points(path: str | Path) -> np.ndarray:
    """The points of a scan, shape (n, 3) float64, in the numbers of the file; LPS where its
    header says SPACE=RAS.

    Text holds x, y and z in the first three columns of each line, split by blanks, commas or semicolons, under at
    most one line of titles. Of a surface the vertices are taken, and the middles of its triangles. Colours and
    other columns are passed over.

    Raises:
        InputError: the file is missing, too large or cannot be read, or a number is not finite.
    """
    path = Path(path)
    kinds = ", ".join(sorted({*ENDINGS, *_TEXT}))
    content = read_bytes(path, f"a file of points or a surface ({kinds}) was expected", MOST_SURFACE)
    ending = path.suffix.lower()
    if ending not in ENDINGS and ending not in _TEXT:
        raise InputError(f"{path}: cannot be read as points ('{ending}' is not known); use {kinds}")
    try:
        with limited_memory(len(content)):
            points = _parsed(ending, content)
            if ending in ENDINGS and stated_space(ending, content) == "RAS":
                points *= (-1.0, -1.0, 1.0)
    except Exception as error:  # each format fails with errors of its own
        raise InputError(f"{path}: cannot be read as points ({reason(error)}); write it again") from error
    bad = np.flatnonzero(~(np.isfinite(points).all(axis=1) & (np.abs(points).max(axis=1, initial=0.0) < 1e7)))
    if len(bad):
        raise InputError(f"{path}: point {bad[0]} is {points[bad[0]]}, not three finite numbers; remove it")
    return points


def _parsed(ending: str, content: bytes) -> np.ndarray:
    if ending in _TEXT:
        return _table(content)
    if ending == ".ply":
        columns = ply_columns(content)
        if not columns.get("face"):
            vertex = columns["vertex"]
            return np.column_stack([vertex[axis][0] for axis in "xyz"]).astype(np.float64)
    if ending == ".obj" and not re.search(rb"^f\s", content, re.MULTILINE):
        return _table(b"\n".join(line[2:] for line in content.splitlines() if line[:2] == b"v "))
    vertices, faces = parse(ending, content)
    return np.vstack([vertices[np.unique(faces)], vertices[faces].mean(axis=1)])


def _table(content: bytes) -> np.ndarray:
    lines = [line for line in (raw.strip() for raw in content.splitlines()) if line and line[:1] not in b"#/"]
    rows = [_SPLIT.split(line)[:3] for line in lines]
    if rows and not rows[0][0][:1].isdigit() and rows[0][0][:1] not in (b"-", b"+", b"."):
        rows = rows[1:]
    if not rows:
        raise ValueError("it holds no points")
    short = next((number for number, row in enumerate(rows, start=1) if len(row) < 3), None)
    if short:
        raise ValueError(f"row {short} has fewer than three numbers")
    return np.array([[number(word.decode()) for word in row] for row in rows])
