"""Named points on bones, and the files of spreadsheets and of 3D Slicer that hold them."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from warp_trunk.checking import Array, check_fields, checked
from warp_trunk.errors import InputError, closest_name
from warp_trunk.geometry.surface import FARTHEST
from warp_trunk.io.atomic_write import csv_text, write_whole
from warp_trunk.io.file_access import is_plain, parsed_number, read_text
from warp_trunk.io.records import read_json

from .anatomy import rank, region
from .axes import MILLIMETRES, Axes, Unit

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


@dataclass(frozen=True, eq=False, repr=False)
class Landmarks:
    """Points with names, `<bone>_<point>` (and `asis_left`, `asis_right`).

    >>> marks = wt.Landmarks(("asis_left", "asis_right"), np.array([[110.0, -60.0, 0.0], [-110.0, -60.0, 0.0]]))
    >>> float(marks.point("asis_left")[0])
    110.0
    """

    names: tuple[str, ...]
    """One name for each point, none twice."""
    points: Annotated[np.ndarray, Array(None, 3)]
    """Positions [mm], shape (n, 3), float64."""

    def __post_init__(self) -> None:
        """Takes lists too; raises InputError for a name given twice, or another number of names than of points."""
        check_fields(self, "landmarks")
        if len(self.points) != len(self.names):
            counts = f"{len(self.points)} for {len(self.names)} names"
            raise InputError(f"landmarks: 'points' must have a row for each name, not {counts}; correct it")
        if len(set(self.names)) < len(self.names):
            twice = sorted({name for name in self.names if self.names.count(name) > 1})
            raise InputError(f"landmarks: '{twice[0]}' is named more than once; give each point its own name")

    def __repr__(self) -> str:
        names = ", ".join((*self.names[:2], "...", *self.names[-1:]) if len(self.names) > 4 else self.names)
        return f"Landmarks({len(self.names)} points: {names})"

    def index(self, name: str) -> int:
        """The row of a landmark; InputError with the nearest name where there is none of that name."""
        if name not in self.names:
            problem = f"there is no '{name}' among the {len(self.names)} landmarks"
            raise InputError(f"landmarks: {problem}{closest_name(str(name), self.names)}")
        return self.names.index(name)

    def point(self, name: str) -> np.ndarray:
        """Position of one landmark [mm], shape (3,); InputError as `index`."""
        return self.points[self.index(name)]

    def rows_of(self, bone: str) -> list[int]:
        """The rows of the landmarks of one bone."""
        return list(_rows_of(self.names, bone))

    def of_bone(self, bone: str) -> Landmarks:
        """The landmarks of one bone, in their order; none where the bone has none."""
        rows = self.rows_of(bone)
        return Landmarks(tuple(self.names[i] for i in rows), self.points[rows].reshape(-1, 3))

    def vertebrae(self) -> tuple[str, ...]:
        """Names of the vertebrae that have a landmark, top to bottom."""
        return _vertebrae_of(self.names)

    def middles(self) -> np.ndarray:
        """The mean of the landmarks of each vertebra, top to bottom [mm], shape (vertebrae, 3)."""
        means = [self.points[self.rows_of(level)].mean(axis=0) for level in self.vertebrae()]
        return np.array(means).reshape(-1, 3)


NO_LANDMARKS = Landmarks((), np.zeros((0, 3)))
"""Those of a part of the body without a spine."""


@lru_cache(maxsize=16)
def _vertebrae_of(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(sorted({level for name in names if region(level := name.partition("_")[0])}, key=rank))


@lru_cache(maxsize=1024)
def _rows_of(names: tuple[str, ...], bone: str) -> tuple[int, ...]:
    return tuple(row for row, name in enumerate(names) if _belongs(name, bone))


def bone_of(name: str, bones: Iterable[str]) -> str | None:
    """The bone among `bones` that a landmark belongs to by its name; None where it is not among them."""
    return max((bone for bone in bones if _belongs(name, bone)), key=len, default=None)


def _belongs(name: str, bone: str) -> bool:
    return ASIS[name] == bone if name in ASIS else name.startswith(f"{bone}_")


COLUMNS = ("name", "x", "y", "z")
"""The columns of a table of landmarks, unless others are named."""
ENDINGS = (".csv", ".mrk.json", ".fcsv")
"""Endings of the files that are read."""
_SLICER_UNITS = {**MILLIMETRES, "um": 1e-3, "µm": 1e-3}
"""Units of markups [mm]."""
_SLICER_AXES = {"LPS": "LPS", "1": "LPS", "RAS": "RAS", "0": "RAS"}
"""The names of axes in files of 3D Slicer; the numbers are those of Slicer before 4.11."""
_SLICER_COLUMNS = "id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label"
_EXPECTED, _CURE = "markups of 3D Slicer were expected", "save the markups again from 3D Slicer"


@checked
def read_landmarks(
    path: str | Path, axes: Axes | None = None, units: Unit = "mm", columns: tuple[str, str, str, str] = COLUMNS
) -> Landmarks:
    """Landmarks in LPS and mm from a CSV table, or from the markups of 3D Slicer (.mrk.json, .fcsv).

    >>> wt.write_case(folder / "marked", case)
    >>> wt.read_landmarks(folder / "marked" / "landmarks_before.csv").names == case.landmarks_before.names
    True

    A file of 3D Slicer names its axes and units; those of a table are given here.

    Args:
        path: the file; its ending says what it is.
        axes: those of a table; LPS when left out.
        units: of a table: mm, cm, m or in.
        columns: the columns of a table that hold name, x, y and z.

    Raises:
        InputError: a missing or unreadable file, a landmark that is named twice or not at all, a coordinate
            that is not a finite number, or no landmark.
    """
    path = Path(path)
    if path.name.lower().endswith(".mrk.json"):
        return _read_markups(path)
    if path.name.lower().endswith(".fcsv"):
        return _read_fcsv(path)
    names, points = read_rows(path, columns)
    return Landmarks(names, (axes or Axes("LPS")).points_to_lps(points, units))


def read_rows(path: Path, columns: tuple[str, ...]) -> tuple[tuple[str, ...], np.ndarray]:
    """Names and numbers, shape (n, columns - 1), from the columns of a CSV file, as they stand.

    Args:
        path: the file, which begins with the names of its columns.
        columns: which of them hold the landmark's name and its coordinates.

    Raises:
        InputError: as `read_table`, an empty name or one used twice, a coordinate that is not a finite number, or
            no landmark at all.
    """
    rows = [(row["place"], *(row[column] for column in columns)) for row in read_table(path, columns)]
    return _named(path, columns[1:], rows)


def read_table(path: Path, columns: tuple[str, ...]) -> list[dict[str, str]]:
    """The rows of a CSV file by column, and the line of each as `place`; empty lines are left out.

    Fields are split by commas, or by the semicolons or tabs of the first line, as spreadsheets write them in
    languages with decimal commas, which become points.

    Raises:
        InputError: an unreadable file, a header without these columns, or a line with another number of fields.
    """
    text = read_text(path, f"a table is given as CSV ({','.join(columns)}) in UTF-8")
    first = text.partition("\n")[0]
    split = next((mark for mark in ";\t" if mark in first and "," not in first), ",")
    header, *rows = _csv_rows(path, io.StringIO(text, newline=""), split) or [[]]
    if columns == COLUMNS:
        header = [name.lower() for name in header]
    if any(header.count(column) != 1 for column in columns):
        raise InputError(
            f"{path}: the first line must name the columns {','.join(columns)} once each, not "
            f"'{','.join(header)[:80]}'; correct it, or name the columns in case.toml as landmark_columns"
        )
    table = []
    for line, row in enumerate(rows, start=2):
        if not any(row):
            continue
        if len(row) != len(header):
            entry = ",".join(row)[:80]
            raise InputError(f"{path}, line {line}: a landmark is {','.join(header)}, not '{entry}'; correct it")
        fields = row if split == "," else [field.replace(",", ".") for field in row]
        table.append({**dict(zip(header, fields, strict=True)), "place": f"{path}, line {line}"})
    return table


def _csv_rows(path: Path, lines: Iterable[str], comma: str = ",") -> list[list[str]]:
    try:
        return [[field.strip() for field in row] for row in csv.reader(lines, delimiter=comma)]
    except csv.Error as error:
        raise InputError(f"{path}: cannot be read ({error}); it must be CSV text in UTF-8") from error


def _named(
    path: Path, axes: Sequence[str], rows: Iterable[Sequence[str | float]]
) -> tuple[tuple[str, ...], np.ndarray]:
    """Names and coordinates of rows of a place in a file, a name and a coordinate for each axis."""
    points: dict[str, list[float]] = {}
    for where, name, *coordinates in rows:
        name = str(name)
        if not name or not is_plain(name):
            raise InputError(f"{where}: a point has a name of letters in one line, not '{name[:40]}'; rename it")
        if name in points:
            raise InputError(f"{where}: '{name}' is the name of a point above; give each landmark once")
        points[name] = []
        for axis, coordinate in zip(axes, coordinates, strict=True):
            try:
                value = parsed_number(coordinate) if isinstance(coordinate, str) else coordinate
            except ValueError:
                value = np.nan
            if not abs(value) <= FARTHEST:  # nor is NaN
                raise InputError(
                    f"{where}: {axis} of '{name}' must be a finite number within {FARTHEST:g}, not "
                    f"'{str(coordinate)[:40]}'; correct it or leave the point out"
                )
            points[name].append(value)
    if not points:
        raise InputError(f"{path}: there is no point in it; a case needs six for each vertebra and the ASIS")
    return tuple(points), np.array(list(points.values()), dtype=np.float64)


class _Point(msgspec.Struct, rename="camel"):
    label: str = ""
    position: tuple[float, float, float] | None = None
    position_status: str = "defined"


class _Markup(msgspec.Struct, rename="camel"):
    coordinate_system: str | int = "LPS"
    coordinate_units: str | list[str] = "mm"
    control_points: list[_Point] = []


class _Markups(msgspec.Struct):
    markups: list[_Markup]


def _read_markups(path: Path) -> Landmarks:
    """The control points that were placed, of all markups in a .mrk.json file."""
    markups = read_json(path, _Markups, _EXPECTED, "cannot be read as markups", _CURE).markups
    frames = {
        (str(markup.coordinate_system), unit) for markup in markups for unit in _units_of(markup.coordinate_units)
    }
    if len(frames) > 1:
        raise InputError(f"{path}: all markups must be in the same axes and units; save them one by one")
    axes, units = frames.pop() if frames else ("LPS", "mm")
    if units not in _SLICER_UNITS:
        raise InputError(f"{path}: 'coordinateUnits' must be {', '.join(_SLICER_UNITS)}, not {units!r}; {_CURE}")
    points = [point for markup in markups for point in markup.control_points if point.position_status == "defined"]
    rows = [(point.label, *point.position) for point in points if point.position is not None]
    return _of_slicer(path, rows, axes, units)


def _units_of(unit: str | list[str]) -> list[str]:
    """A unit, the units of the axes, or the first of a code, its scheme and its meaning."""
    if isinstance(unit, str):
        return [unit]
    return unit[:1] if "UCUM" in unit else unit


def _read_fcsv(path: Path) -> Landmarks:
    """The points of a .fcsv file."""
    lines = read_text(path, _EXPECTED).split("\n")
    header = [line[1:].partition("=") for line in lines if line.startswith("#")]
    settings = {key.strip(): value.strip() for key, _, value in header}
    if "CoordinateSystem" not in settings:
        raise InputError(f"{path}: does not say '# CoordinateSystem = LPS' or RAS; {_CURE}")
    columns = settings.get("columns", _SLICER_COLUMNS).replace(" ", "").split(",")
    if not {"x", "y", "z", "label"} <= set(columns):
        raise InputError(f"{path}: '# columns' must name x, y, z and label, not {','.join(columns)[:80]}; {_CURE}")
    places = [columns.index(column) for column in ("label", "x", "y", "z")]
    rows = _csv_rows(path, (line for line in lines if line.strip() and not line.startswith("#")))
    for row in rows:
        if len(row) <= max(places):
            raise InputError(f"{path}: a point is {','.join(columns)[:80]}, not '{','.join(row)[:80]}'; {_CURE}")
    return _of_slicer(path, [[row[place] for place in places] for row in rows], settings["CoordinateSystem"], "mm")


def _of_slicer(path: Path, rows: Sequence[Sequence[str | float]], axes: str, units: str) -> Landmarks:
    """Landmarks of rows of a label and coordinates in the axes and units of a file of 3D Slicer."""
    if axes not in _SLICER_AXES:
        raise InputError(f"{path}: the coordinate system must be LPS or RAS, not {axes[:40]!r}; {_CURE}")
    names, points = _named(path, "xyz", [(f"{path}, point {n}", *row) for n, row in enumerate(rows, start=1)])
    return Landmarks(names, Axes(_SLICER_AXES[axes]).points_to_lps(points * _SLICER_UNITS[units]))


def write_landmarks(path: str | Path, landmarks: Landmarks) -> None:
    """Write a CSV file that `read_landmarks` reads back to the last bit."""
    rows = zip(landmarks.names, *landmarks.points.T.tolist(), strict=True)
    write_whole(Path(path), csv_text([COLUMNS, *rows]))


def landmark_file(folder: Path, stem: str) -> Path:
    """The file of a folder that holds landmarks under this name; its CSV name where there is none.

    Raises:
        InputError: there is more than one.
    """
    files = [folder / (stem + ending) for ending in ENDINGS if (folder / (stem + ending)).is_file()]
    if len(files) > 1:
        raise InputError(f"{files[1]}: there is {files[0].name} beside it; give '{stem}' in one file")
    return files[0] if files else folder / f"{stem}.csv"
