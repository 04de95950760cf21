"""PLY: text or binary of either byte order, with polygons of any size and whatever else it holds passed over.

trimesh takes the size of the first polygon for that of all, so it refuses what Blender writes and does not notice
a damaged size: hence a reader of our own.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field

import numpy as np

from .polygons import fans

_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass
class _Element:
    name: str
    count: int
    properties: list[tuple[str, str, str | None]] = field(default_factory=list)
    """Name, type, and for a list the type of its length."""


def read_ply(content: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles.

    Raises:
        ValueError: no such header, or other data than it says.
    """
    found = re.match(rb"ply\r?\n(.*?)\nend_header[ \t]*\r?\n", content, re.DOTALL)
    if found is None:
        raise ValueError("the header of a PLY, with its end, was expected")
    order, elements = _header(found[1].decode("ascii", errors="replace"))
    said = sum(element.count for element in elements)
    if said > len(content) - found.end():  # each takes a byte at least
        raise ValueError(f"the header says {said} elements, the file has {len(content)} bytes")
    if not any(element.name == "face" and element.count for element in elements):
        raise ValueError("it holds points without triangles; make a surface of them")
    data = _Text(content[found.end() :]) if order == "" else _Binary(content[found.end() :], order)
    columns = {}
    for element in elements:
        names = [name for name, *_ in element.properties]
        columns[element.name] = dict(zip(names, data.rows(element), strict=True))
    data.check_end()
    vertex, face = columns.get("vertex", {}), columns["face"]
    named = next((face[name] for name in ("vertex_indices", "vertex_index") if name in face), None)
    if named is None or not {"x", "y", "z"} <= vertex.keys():
        raise ValueError("vertices with x, y and z and faces with vertex_indices were expected")
    corners, ends = named
    if not np.issubdtype(corners.dtype, np.integer):
        raise ValueError("vertices are named by whole numbers")
    return np.column_stack([vertex[axis] for axis in "xyz"]).astype(np.float64), fans(
        corners.astype(np.int64), ends
    )


def _header(text: str) -> tuple[str, list[_Element]]:
    order, elements = None, []
    for line in text.splitlines():
        words = line.split()
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format" and len(words) == 3 and words[1] in _FORMATS:
            order = _FORMATS[words[1]]
        elif words[0] == "element" and len(words) == 3 and re.fullmatch(r"\d{1,18}", words[2]):
            elements.append(_Element(words[1], int(words[2])))
        elif words[0] == "property" and elements and len(words) == 3:
            elements[-1].properties.append((words[2], _TYPES[words[1]], None))
        elif words[0] == "property" and elements and len(words) == 5 and words[1] == "list":
            elements[-1].properties.append((words[4], _TYPES[words[3]], _TYPES[words[2]]))
        else:
            raise ValueError(f"its header has {line[:40]!r}")
    if order is None:
        raise ValueError("its header does not say its format")
    return order, elements


def _arrays(element: _Element, columns: list[list], ends: list[list[int]]) -> list:
    """A column for each property, or the items of a list and where each row ends among them."""
    return [
        (np.array(column), np.array(end, dtype=np.int64)) if size else np.array(column)
        for column, end, (*_, size) in zip(columns, ends, element.properties, strict=True)
    ]


class _Text:
    def __init__(self, body: bytes) -> None:
        if b"_" in body:
            raise ValueError("numbers have no underscores")
        self._words, self._at = body.split(), 0

    def rows(self, element: _Element) -> list:
        """The columns of an element, see `_arrays`."""
        if not any(size for *_, size in element.properties):
            width = len(element.properties)
            values = np.array(self._next(width * element.count), dtype=np.float64).reshape(element.count, width)
            return list(values.T)
        columns: list[list] = [[] for _ in element.properties]
        ends: list[list[int]] = [[] for _ in element.properties]
        for _ in range(element.count):
            for place, (_, kind, size) in enumerate(element.properties):
                count = 1 if size is None else int(self._next(1)[0])
                read = int if kind[0] in "iu" else float
                columns[place] += [read(word) for word in self._next(count)]
                ends[place].append(len(columns[place]))
        return _arrays(element, columns, ends)

    def _next(self, count: int) -> list[bytes]:
        words = self._words[self._at : self._at + count] if count >= 0 else []
        if len(words) != count:
            raise ValueError("it is cut off")
        self._at += count
        return words

    def check_end(self) -> None:
        if self._at != len(self._words):
            raise ValueError("more numbers follow than its header says")


class _Binary:
    def __init__(self, body: bytes, order: str) -> None:
        self._body, self._order, self._at = body, order, 0

    def rows(self, element: _Element) -> list:
        """The columns of an element, see `_arrays`."""
        sizes = self._first_sizes(element) if element.count else []
        rows = self._equal_rows(element, sizes)
        return self._unequal_rows(element) if rows is None else rows

    def _first_sizes(self, element: _Element) -> list[int]:
        """Length of each list of the first row."""
        at, sizes = self._at, []
        for _, kind, size in element.properties:
            count = 1
            if size:
                count = int(self._values(size, 1, at)[0])
                at += np.dtype(size).itemsize
                sizes.append(count)
            at += max(count, 0) * np.dtype(kind).itemsize
        return sizes

    def _equal_rows(self, element: _Element, sizes: list[int]) -> list | None:
        """All rows at once where their lists are as long as those of the first; None where they are not."""
        left, parts = iter(sizes), []
        for place, (_, kind, size) in enumerate(element.properties):
            if size:
                parts.append((f"n{place}", self._order + size))
            count = next(left, 0) if size else 1
            if not 0 <= count <= len(self._body):
                raise ValueError(f"a list of {count} items was not expected")
            parts.append((f"v{place}", self._order + kind, (count,)))
        dtype = np.dtype(parts)
        if self._at + element.count * dtype.itemsize > len(self._body):
            return None
        table = np.frombuffer(self._body, dtype, element.count, self._at)
        left, columns = iter(sizes), []
        for place, (*_, size) in enumerate(element.properties):
            column = table[f"v{place}"].reshape(-1)
            if size:
                count = next(left, 0)
                if (table[f"n{place}"] != count).any():
                    return None
                columns.append((column, count * np.arange(1, element.count + 1)))
            else:
                columns.append(column)
        self._at += element.count * dtype.itemsize
        return columns

    def _unequal_rows(self, element: _Element) -> list:
        columns: list[list] = [[] for _ in element.properties]
        ends: list[list[int]] = [[] for _ in element.properties]
        for _ in range(element.count):
            for place, (_, kind, size) in enumerate(element.properties):
                count = int(self._take(size, 1)[0]) if size else 1
                columns[place] += self._take(kind, count)
                ends[place].append(len(columns[place]))
        return _arrays(element, columns, ends)

    def _take(self, kind: str, count: int) -> tuple:
        width = count * np.dtype(kind).itemsize
        if count < 0 or self._at + width > len(self._body):
            raise ValueError("it is cut off")
        values = struct.unpack_from(f"{self._order}{count}{np.dtype(kind).char}", self._body, self._at)
        self._at += width
        return values

    def _values(self, kind: str, count: int, at: int) -> np.ndarray:
        return np.frombuffer(self._body, np.dtype(self._order + kind), count, at)

    def check_end(self) -> None:
        if self._at != len(self._body):
            raise ValueError(f"its header says {self._at} bytes of data, it has {len(self._body)}")
