"""PLY: text or binary of either byte order, with polygons of any size and whatever else it holds passed over.

A reader of our own: trimesh 5.2 refuses binary files with polygons of several sizes, which Blender writes, and
reads a text that lacks its last face, a corner 1.5 and a damaged number of corners without an error; meshio 5.3
refuses `vertex_index` and further elements, such as edges.
"""

from __future__ import annotations

import re

import numpy as np

from ..file_access import FormatError, numbers
from .polygons import fans

_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_Property = tuple[str, str, str | None]
"""Name, type, and for a list the type of its length."""


_Columns = dict[str, dict[str, tuple[np.ndarray, np.ndarray]]]
"""By element and property its values, and where each row ends among them."""


def ply_columns(content: bytes) -> _Columns:
    """The elements of a file.

    Raises:
        FormatError: no such header, or other data than it says.
    """
    header = re.match(rb"ply\r?\n(.*?)\nend_header[ \t]*\r?\n", content, re.DOTALL)
    if header is None:
        raise FormatError("the header of a PLY, with its end, was expected")
    order, elements = _header(header[1].decode("ascii", errors="replace"))
    body = content[header.end() :]
    said = sum(count for _, count, _ in elements)
    if said > len(body):  # each takes a byte at least
        raise FormatError(f"the header says {said} elements, the file has {len(content)} bytes")
    if not order:
        body = numbers(body.split()).tobytes()
    at, columns = 0, {}
    for name, count, properties in elements:
        header, at = _columns(body, at, count, properties)
        columns[name] = header if count else {}
    if at != len(body):
        raise FormatError(f"{len(body) - at} bytes more follow than its header says")
    return columns


def read_ply(content: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Vertices, triangles, and colours of the vertices where there are some.

    Raises:
        FormatError: no such header, other data than it says, or no triangles.
    """
    columns = ply_columns(content)
    vertex, face = columns.get("vertex", {}), columns.get("face", {})
    if not face:
        raise FormatError("it holds points without triangles; make a surface of them, or give it to fit-back")
    corners = next((face[name] for name in face if re.fullmatch(r"vert\w*_?ind\w*", name, re.IGNORECASE)), None)
    if corners is None or not {"x", "y", "z"} <= vertex.keys():
        raise FormatError("vertices with x, y and z and faces with vertex_indices were expected")
    odd = corners[0][~((corners[0] == np.rint(corners[0])) & (np.abs(corners[0]) < 2**31))]
    if odd.size:
        raise FormatError(f"vertices are named by whole numbers, not {odd[0]}")
    points = np.column_stack([vertex[axis][0] for axis in "xyz"]).astype(np.float64)
    return points, fans(corners[0].astype(np.int64), corners[1]), ply_colours(columns)


def ply_colours(columns: _Columns) -> np.ndarray | None:
    """The numbers of red, green and blue of each vertex, shape (vertices, 3); None without any."""
    vertex = columns.get("vertex", {})
    for before in ("", "diffuse_"):
        names = [f"{before}{name}" for name in ("red", "green", "blue")]
        if vertex.keys() >= set(names):
            return np.column_stack([vertex[name][0] for name in names])
    return None


def _header(text: str) -> tuple[str, list[tuple[str, int, list[_Property]]]]:
    """The byte order, empty for text, and for each element its name, count and properties."""
    order, elements = None, []
    for line in text.splitlines():
        words = line.split()
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format" and len(words) == 3 and words[1] in _FORMATS:
            order = _FORMATS[words[1]]
        elif words[0] == "element" and len(words) == 3 and re.fullmatch(r"\d{1,18}", words[2]):
            elements.append((words[1], int(words[2]), []))
        elif words[0] == "property" and elements and len(words) == (5 if words[1] == "list" else 3):
            if unread := [word for word in words[1:-1] if word != "list" and word not in _TYPES]:
                raise FormatError(f"its header has numbers of type {unread[0][:20]!r}")
            kinds = [order + _TYPES[word] if order else "f8" for word in words[-2:0:-1] if word != "list"]
            elements[-1][2].append((words[-1], kinds[0], kinds[1] if len(kinds) == 2 else None))
        else:
            raise FormatError(f"its header has {line[:40]!r}")
    if order is None:
        raise FormatError("its header does not say its format")
    return order, elements


def _columns(
    body: bytes, at: int, count: int, properties: list[_Property]
) -> tuple[dict[str, tuple[np.ndarray, np.ndarray]], int]:
    """By property its values and where each row ends among them; and where the element ends in the body."""
    tables = _tables(body, at, count, properties)
    columns = {}
    for place, (name, kind, _) in enumerate(properties):
        parts = [table[f"values{place}"] for table in tables]
        sizes = np.repeat(np.array([part.shape[1] for part in parts], dtype=int), [len(part) for part in parts])
        values = np.concatenate([np.empty(0, kind), *(part.reshape(-1) for part in parts)])
        columns[name] = values, np.cumsum(sizes)
    return columns, at + sum(table.nbytes for table in tables)


def _tables(body: bytes, at: int, count: int, properties: list[_Property]) -> list[np.ndarray]:
    """The rows of an element: one table where their lists are of one length, else a table for each row."""
    if not count:
        return []
    kind = _row(body, at, properties)
    if at + count * kind.itemsize <= len(body):
        table = np.frombuffer(body, kind, count, at)
        lengths = [table[name] for name in kind.names or () if name.startswith("length")]
        if all((length == length[0]).all() for length in lengths):
            return [table]
    tables = []
    for _ in range(count):
        kind = _row(body, at, properties)
        tables.append(np.frombuffer(body, kind, 1, at))
        at += kind.itemsize
    return tables


def _row(body: bytes, at: int, properties: list[_Property]) -> np.dtype:
    """The type of the row that begins at a place, its lists as long as they are there."""
    parts = []
    for place, (_, kind, size) in enumerate(properties):
        count = 1
        if size:
            parts.append((f"length{place}", size))
            end = at + np.dtype(size).itemsize
            count = int(np.frombuffer(body, size, 1, at)[0]) if end <= len(body) else -1
            at = end
        at += count * np.dtype(kind).itemsize
        if count < 0 or at > len(body):
            raise FormatError("it is cut off")
        parts.append((f"values{place}", kind, (count,)))
    return np.dtype(parts)
