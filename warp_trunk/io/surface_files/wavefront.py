"""OBJ: vertices and polygons. Materials, textures and normals are passed over, so no other file is opened."""

from __future__ import annotations

import numpy as np

from ..file_access import number
from .polygons import fans


def read_obj(content: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles.

    trimesh 5.2 repeats vertices where the material changes, which opens a closed skin, and reads a vertex of two
    numbers and a corner 0 without a word.

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
