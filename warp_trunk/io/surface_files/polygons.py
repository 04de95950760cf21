"""Polygons cut into triangles, and OBJ, a text of vertices and polygons.

The reader of OBJ is our own: trimesh 5.2 repeats vertices where the material changes, which opens a closed skin,
and reads a vertex of two numbers and a corner 0 without an error; meshio 5.3 refuses texture coordinates.
Normals are passed over. Materials and textures lie in other files, which are opened where they lie in its folder.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from warp_trunk.geometry.colours import mean_colours

from ..file_access import FormatError, parsed_number
from .textures import corner_colours, read_materials


def fans(corners: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Triangles of polygons, each a fan around its first corner, shape (m, 3), in the order of the polygons.

    Args:
        corners: vertex numbers of all polygons, one after the other.
        ends: where each polygon ends among them.

    Raises:
        FormatError: ends that do not divide the corners into polygons of three corners or more.
    """
    ends = np.asarray(ends, dtype=np.int64)
    sizes = np.diff(ends, prepend=0)
    if (ends[-1] if len(ends) else 0) != len(corners) or (sizes < 3).any():
        raise FormatError("a polygon has fewer than 3 corners, or their numbers do not add up")
    triangles = sizes - 2
    first = np.repeat(ends - sizes, triangles)
    step = np.arange(triangles.sum()) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return corners[np.column_stack([first, first + step + 1, first + step + 2])]


def read_obj(content: bytes, path: Path | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Vertices, triangles and colours of an OBJ, those of its vertices or of its textures; None without any.

    Args:
        content: of the file.
        path: of the file, beside which its materials and textures lie; they are left out without one.

    Raises:
        FormatError: a vertex without three numbers, or a corner that names none of the vertices.
    """
    text = content.decode("utf-8-sig", errors="replace").replace("\\\r\n", " ").replace("\\\n", " ")
    vertices: list[list[float]] = []
    corners: list[int] = []
    ends: list[int] = []
    colours: list[list[float]] = []
    places: list[list[float]] = []
    shown: list[int] = []
    uses = [(0, "")]  # the first polygon of each material
    libraries: list[str] = []
    for place, line in enumerate(text.split("\n"), start=1):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        if words[0] == "v":
            if len(words) < 4:
                raise FormatError(f"line {place}: a vertex needs x, y and z, not {line.strip()[:40]!r}")
            vertices.append([parsed_number(word) for word in words[1:4]])
            if len(words) >= 7:
                colours.append([_number_if_any(word) for word in words[4:7]])
        elif words[0] == "vt" and len(words) > 2:
            places.append([_number_if_any(word) for word in words[1:3]])
        elif words[0] == "usemtl":
            uses.append((len(ends), " ".join(words[1:])))
        elif words[0] == "mtllib":
            libraries += line.strip().split(None, 1)[1:]
        elif words[0] == "f":
            for word in words[1:]:
                corner, in_picture, *_ = *(_index(part) for part in word.split("/")), 0
                if corner == 0 or len(vertices) + corner < 0:
                    raise FormatError(f"line {place}: there is no vertex {word[:40]}")
                corners.append(corner - 1 if corner > 0 else len(vertices) + corner)
                shown.append(in_picture - 1 if in_picture > 0 else max(len(places) + in_picture, -1))
            ends.append(len(corners))
    points, last = np.array(vertices, dtype=np.float64), np.array(ends)
    faces, mixed = fans(np.array(corners, dtype=np.int64), last), None
    if colours and len(colours) == len(vertices):
        mixed = np.array(colours)
    elif path is not None and libraries and places and (materials := read_materials(path, libraries)):
        named = fans(np.array(shown, dtype=np.int64), last)  # in the picture; -1 and what is missing, nowhere
        in_picture = np.array([*places, [np.nan, np.nan]])[np.minimum(named, len(places))]
        triangles = np.concatenate([[0], np.cumsum(np.diff(last, prepend=0) - 2)])
        seen = np.full((*faces.shape, 3), np.nan)
        for (first, name), (after, _) in zip(uses, [*uses[1:], (len(ends), "")], strict=True):
            part = slice(triangles[first], triangles[after])
            if name in materials:
                seen[part] = corner_colours(in_picture[part], materials[name])
        mixed = mean_colours(seen.reshape(-1, 3), faces.reshape(-1), len(points))
    return points, faces, mixed


def _index(text: str) -> int:
    """A number of a vertex or of a place in the picture, from 1, or from -1 backwards; 0 for what is none."""
    return int(text) if re.fullmatch(r"[-+]?\d{1,18}", text, re.ASCII) else 0


def _number_if_any(text: str) -> float:
    """A number that is not needed: NaN where it is none."""
    try:
        return parsed_number(text)
    except FormatError:
        return float("nan")
