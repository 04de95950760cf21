"""Markups of 3D Slicer: points with labels, in the two formats it has written."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import FARTHEST
from warp_trunk.io.file_access import is_plain, number, read_text

from ..axes import MILLIMETRES, Axes
from .landmarks import Landmarks

_AXES = {"LPS": "LPS", "1": "LPS", "RAS": "RAS", "0": "RAS"}
"""What files call their axes; the numbers are those of Slicer before 4.11."""
_EXPECTED = "markups of 3D Slicer were expected"
_CURE = "save the markups again from 3D Slicer"


def read_markups(path: Path) -> Landmarks:
    """Control points of a .mrk.json file in LPS and mm, of all the markups in it.

    Raises:
        InputError: no such JSON, axes other than LPS or RAS, units other than mm, cm or m, or a point without
            a label of its own or without three finite coordinates.
    """
    text = read_text(path, _EXPECTED)
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as JSON ({error}); {_CURE}") from error
    markups = content.get("markups") if isinstance(content, dict) else None
    if not isinstance(markups, list) or not all(isinstance(markup, dict) for markup in markups):
        raise InputError(f"{path}: has no list 'markups'; {_CURE}")
    rows: list[tuple[Any, Any]] = []
    axes = units = None
    for markup in markups:
        here = _axes(path, markup.get("coordinateSystem", "LPS")), markup.get("coordinateUnits", "mm")
        if axes is not None and here != (axes, units):
            raise InputError(f"{path}: all markups must be in the same axes and units; save them one by one")
        axes, units = here
        points = markup.get("controlPoints", [])
        if not isinstance(points, list) or not all(isinstance(point, dict) for point in points):
            raise InputError(f"{path}: 'controlPoints' must be a list of points; {_CURE}")
        rows += [
            (point.get("label"), point.get("position"))
            for point in points
            if point.get("positionStatus", "defined") == "defined"
        ]
    if units not in (None, *MILLIMETRES):
        raise InputError(
            f"{path}: 'coordinateUnits' must be one of {', '.join(MILLIMETRES)}, not {units!r}; {_CURE}"
        )
    return _landmarks(path, rows, axes or "LPS", units or "mm")


def read_fcsv(path: Path) -> Landmarks:
    """Points of a .fcsv file in LPS and mm.

    Raises:
        InputError: an unreadable file, one that does not say its axes, or a point without a label of its own
            or without three finite coordinates.
    """
    lines = read_text(path, _EXPECTED).split("\n")
    said = dict(
        [part.strip() for part in line[1:].split("=", 1)] for line in lines if line.startswith("#") and "=" in line
    )
    if "CoordinateSystem" not in said:
        raise InputError(f"{path}: does not say '# CoordinateSystem = LPS' or RAS; {_CURE}")
    columns = [
        column.strip() for column in said.get("columns", "id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label").split(",")
    ]
    missing = {"x", "y", "z", "label"} - set(columns)
    if missing:
        raise InputError(f"{path}: '# columns' must name x, y, z and label, not {','.join(columns)[:80]}; {_CURE}")
    places = [columns.index(column) for column in ("x", "y", "z")]
    rows: list[tuple[Any, Any]] = []
    try:
        table = list(csv.reader(line for line in lines if line.strip() and not line.startswith("#")))
    except csv.Error as error:
        raise InputError(f"{path}: cannot be read ({error}); {_CURE}") from error
    for row in table:
        if len(row) <= max(*places, columns.index("label")):
            raise InputError(f"{path}: a point is {','.join(columns)[:80]}, not '{','.join(row)[:80]}'; {_CURE}")
        rows.append((row[columns.index("label")].strip(), [row[place] for place in places]))
    return _landmarks(path, rows, _axes(path, said["CoordinateSystem"]), "mm")


def _axes(path: Path, said: Any) -> str:
    if str(said) not in _AXES:
        raise InputError(f"{path}: the coordinate system must be LPS or RAS, not {str(said)[:40]!r}; {_CURE}")
    return _AXES[str(said)]


def _landmarks(path: Path, rows: list[tuple[Any, Any]], axes: str, units: str) -> Landmarks:
    if not rows:
        raise InputError(f"{path}: there is no point in it; a case needs six for each vertebra and the ASIS")
    names: dict[str, None] = {}
    points = np.empty((len(rows), 3))
    for row, (name, position) in enumerate(rows):
        if not isinstance(name, str) or not name:
            raise InputError(f"{path}: point {row + 1} has no label; label every point as <bone>_<point>")
        if not is_plain(name):
            raise InputError(f"{path}: the label '{name[:40]}' has a line break or control character; rename it")
        if name in names:
            raise InputError(f"{path}: '{name}' labels more than one point; give each landmark once")
        names[name] = None
        try:
            if not isinstance(position, list) or len(position) != 3:
                raise ValueError
            points[row] = [_coordinate(value) for value in position]
        except (TypeError, ValueError, OverflowError):
            raise InputError(
                f"{path}: the position of '{name}' must be three numbers, not {str(position)[:60]}; place it again"
            ) from None
        if not (np.abs(points[row]) <= FARTHEST).all():  # nor is NaN
            raise InputError(
                f"{path}: the position of '{name}' must be finite and within {FARTHEST:g}, not "
                f"{str(position)[:60]}; place it again"
            )
    return Landmarks(tuple(names), Axes(axes).points_to_lps(points, units))


def _coordinate(value: Any) -> float:
    """A coordinate of a point; TypeError for true and false, though Python counts with them."""
    if isinstance(value, bool):
        raise TypeError
    return number(value) if isinstance(value, str) else float(value)
