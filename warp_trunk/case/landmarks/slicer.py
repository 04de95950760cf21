"""Markups of 3D Slicer: labelled points in its two file formats."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import FARTHEST
from warp_trunk.io.file_access import is_plain, number, read_text

from ..axes import MILLIMETRES, Axes
from .landmarks import Landmarks

_AXES = {"LPS": "LPS", "1": "LPS", "RAS": "RAS", "0": "RAS"}
"""The names of axes in files; the numbers are those of Slicer before 4.11."""
_EXPECTED = "markups of 3D Slicer were expected"
_CURE = "save the markups again from 3D Slicer"


class _Point(msgspec.Struct, rename="camel"):
    label: str = ""
    position: tuple[float, float, float] | None = None
    position_status: str = "defined"


class _Markup(msgspec.Struct, rename="camel"):
    coordinate_system: str | int = "LPS"
    coordinate_units: str = "mm"
    control_points: list[_Point] = []


class _Markups(msgspec.Struct):
    markups: list[_Markup]


def read_markups(path: Path) -> Landmarks:
    """Control points of all markups in a .mrk.json file, in LPS and mm.

    Raises:
        InputError: the file is not such JSON, the axes are not LPS or RAS, the units are not mm, cm or m, or a
            point has no label of its own or no three finite coordinates.
    """
    text = read_text(path, _EXPECTED)
    try:
        markups = msgspec.json.decode(text, type=_Markups).markups
    except (msgspec.DecodeError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as markups ({error}); {_CURE}") from error
    frames = {(str(markup.coordinate_system), markup.coordinate_units) for markup in markups}
    if len(frames) > 1:
        raise InputError(f"{path}: all markups must be in the same axes and units; save them one by one")
    axes, units = frames.pop() if frames else ("LPS", "mm")
    if units not in MILLIMETRES:
        raise InputError(
            f"{path}: 'coordinateUnits' must be one of {', '.join(MILLIMETRES)}, not {units!r}; {_CURE}"
        )
    points = [point for markup in markups for point in markup.control_points if point.position_status == "defined"]
    return _landmarks(path, [(point.label, point.position or ()) for point in points], axes, units)


def read_fcsv(path: Path) -> Landmarks:
    """Points of a .fcsv file in LPS and mm.

    Raises:
        InputError: the file cannot be read or does not name its axes, or a point has no label of its own or no
            three finite coordinates.
    """
    lines = read_text(path, _EXPECTED).split("\n")
    header = [line[1:].partition("=") for line in lines if line.startswith("#")]
    said = {key.strip(): value.strip() for key, _, value in header}
    if "CoordinateSystem" not in said:
        raise InputError(f"{path}: does not say '# CoordinateSystem = LPS' or RAS; {_CURE}")
    columns = said.get("columns", "id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label").replace(" ", "").split(",")
    if not {"x", "y", "z", "label"} <= set(columns):
        raise InputError(f"{path}: '# columns' must name x, y, z and label, not {','.join(columns)[:80]}; {_CURE}")
    label, *places = (columns.index(column) for column in ("label", "x", "y", "z"))
    rows: list[tuple[str, Sequence[str]]] = []
    try:
        for row in csv.reader(line for line in lines if line.strip() and not line.startswith("#")):
            if len(row) <= max(label, *places):
                given = ",".join(row)[:80]
                raise InputError(f"{path}: a point is {','.join(columns)[:80]}, not '{given}'; {_CURE}")
            rows.append((row[label].strip(), [row[place] for place in places]))
    except csv.Error as error:
        raise InputError(f"{path}: cannot be read ({error}); {_CURE}") from error
    return _landmarks(path, rows, said["CoordinateSystem"], "mm")


def _landmarks(path: Path, rows: Sequence[tuple[str, Sequence[float | str]]], axes: str, units: str) -> Landmarks:
    """The landmarks of labels and coordinates in the axes and units of the file."""
    if axes not in _AXES:
        raise InputError(f"{path}: the coordinate system must be LPS or RAS, not {axes[:40]!r}; {_CURE}")
    if not rows:
        raise InputError(f"{path}: there is no point in it; a case needs six for each vertebra and the ASIS")
    points: dict[str, list[float]] = {}
    for row, (name, position) in enumerate(rows):
        if not name:
            raise InputError(f"{path}: point {row + 1} has no label; label every point as <bone>_<point>")
        if not is_plain(name):
            raise InputError(f"{path}: the label '{name[:40]}' has a line break or control character; rename it")
        if name in points:
            raise InputError(f"{path}: '{name}' labels more than one point; give each landmark once")
        try:
            points[name] = [number(value) if isinstance(value, str) else value for value in position]
        except ValueError:
            points[name] = []
        if len(points[name]) != 3 or not (np.abs(points[name]) <= FARTHEST).all():  # nor is NaN
            raise InputError(
                f"{path}: the position of '{name}' must be three finite numbers within {FARTHEST:g}, not "
                f"{str(position)[:60]}; place it again"
            )
    return Landmarks(tuple(points), Axes(_AXES[axes]).points_to_lps(np.array(list(points.values())), units))
