"""Polygons cut into triangles, and OBJ, a text of vertices and polygons.

The reader of OBJ is our own: trimesh 5.2 repeats vertices where the material changes, which opens a closed skin,
and reads a vertex of two numbers and a corner 0 without an error; meshio 5.3 refuses texture coordinates.
Materials, textures and normals are passed over, so that no other file is opened.
"""

from __future__ import annotations

import numpy as np

from ..file_access import number


def fans(corners: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Triangles of polygons, each a fan around its first corner, shape (m, 3), in the order of the polygons.

    Args:
        corners: vertex numbers of all polygons, one after the other.
        ends: where each polygon ends among them.

    Raises:
        ValueError: ends that do not divide the corners into polygons of three corners or more.
    """
    ends = np.asarray(ends, dtype=np.int64)
    sizes = np.diff(ends, prepend=0)
    if (ends[-1] if len(ends) else 0) != len(corners) or (sizes < 3).any():
        raise ValueError("a polygon has fewer than 3 corners, or their numbers do not add up")
    triangles = sizes - 2
    first = np.repeat(ends - sizes, triangles)
    step = np.arange(triangles.sum()) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return corners[np.column_stack([first, first + step + 1, first + step + 2])]


def read_obj(content: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of an OBJ.

    Raises:
        ValueError: a vertex without three numbers, or a corner that names none of the vertices.
    """
    text = content.decode("utf-8", errors="replace").replace("\\\r\n", " ").replace("\\\n", " ")
    vertices: list[list[float]] = []
    corners: list[int] = []
    ends: list[int] = []
    for place, line in enumerate(text.split("\n"), start=1):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        if words[0] == "v":
            if len(words) < 4:
                raise ValueError(f"line {place}: a vertex needs x, y and z, not {line.strip()[:40]!r}")
            vertices.append([number(word) for word in words[1:4]])
        elif words[0] == "f":
            for word in words[1:]:
                named = int(word.split("/", 1)[0])
                corner = named - 1 if named > 0 else len(vertices) + named
                if named == 0 or corner < 0 or "_" in word:
                    raise ValueError(f"line {place}: there is no vertex {word[:40]}")
                corners.append(corner)
            ends.append(len(corners))
    return np.array(vertices, dtype=np.float64), fans(np.array(corners, dtype=np.int64), np.array(ends))
