"""VTK's own text format (.vtk), with numbers as text or binary: the points and polygons of a PolyData.

A reader of our own: meshio 5.3 reads grids only and refuses POLYDATA, trimesh 5.2 has no reader, and VTK itself is
a heavy package.
"""

from __future__ import annotations

import numpy as np

from .polygons import fans

_TYPES = {
    "float": ">f4", "double": ">f8", "char": ">i1", "unsigned_char": ">u1", "short": ">i2",
    "unsigned_short": ">u2", "int": ">i4", "unsigned_int": ">u4", "long": ">i8", "unsigned_long": ">u8",
    "vtkidtype": ">i8", "vtktypeint32": ">i4", "vtktypeint64": ">i8",
}  # fmt: skip


def read_vtk(content: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles; cell and point data are passed over.

    Raises:
        ValueError: another kind of data set, triangle strips, or fewer numbers than it says.
    """
    file = _File(content)
    if not file.line().startswith("# vtk DataFile Version"):
        raise ValueError("it does not begin as a VTK file")
    file.line(blank=True)  # its title
    kind = file.line().upper()
    if kind not in ("ASCII", "BINARY"):
        raise ValueError(f"its third line must be ASCII or BINARY, not {kind[:20]!r}")
    file.binary = kind == "BINARY"
    dataset = file.line().upper().split()
    if dataset != ["DATASET", "POLYDATA"]:
        raise ValueError(f"it must hold POLYDATA, not {' '.join(dataset)[:40]!r}; extract the surface")
    points, faces = np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
    while words := file.line().split():
        name = words[0].upper()
        if name == "POINTS":
            points = file.numbers(3 * int(words[1]), words[2]).reshape(-1, 3)
        elif name in ("VERTICES", "LINES", "POLYGONS", "TRIANGLE_STRIPS"):
            corners, ends = file.cells(int(words[1]), int(words[2]))
            if name == "TRIANGLE_STRIPS":
                raise ValueError("it has triangle strips; triangulate it")
            if name == "POLYGONS":
                faces = fans(corners, ends)
        elif name == "METADATA":
            while file.line(blank=True):
                pass
        elif name in ("POINT_DATA", "CELL_DATA"):
            break
        else:
            raise ValueError(f"{words[0][:20]!r} was not expected")
    return points, faces


class _File:
    """The bytes of a file and the place reading has come to."""

    def __init__(self, content: bytes) -> None:
        self._content, self._at = content, 0
        self.binary = False

    def line(self, blank: bool = False) -> str:
        """The next line that is not empty, or the next one; empty at the end of the file."""
        while self._at < len(self._content):
            end = self._content.find(b"\n", self._at)
            end = len(self._content) if end < 0 else end
            text = self._content[self._at : end].decode("latin-1").strip()
            self._at = end + 1
            if text or blank:
                return text
        return ""

    def numbers(self, count: int, kind: str) -> np.ndarray:
        """The next numbers, of a type of VTK."""
        dtype = np.dtype(_TYPES[kind.lower()])
        if not 0 <= count <= len(self._content) - self._at + 1:  # a number takes a byte at least
            raise ValueError(f"it says {count} numbers, {len(self._content) - self._at} bytes are left")
        if self.binary:
            values = np.frombuffer(self._content, dtype, count, self._at)
            self._at += count * dtype.itemsize
            return values.astype(dtype.newbyteorder("="))
        words: list[str] = []
        while len(words) < count and (line := self.line()):
            words += line.split()
        if len(words) != count:
            raise ValueError(f"{count} numbers were expected, not {len(words)}")
        return np.array(words, dtype=np.float64).astype(dtype.newbyteorder("="))

    def cells(self, count: int, size: int) -> tuple[np.ndarray, np.ndarray]:
        """The corners of the next cells, and where each cell ends among them."""
        before = self._at
        words = self.line().split()
        if words and words[0].upper() == "OFFSETS":  # since version 5.1
            ends = self.numbers(count, words[1])
            words = self.line().split()
            if not words or words[0].upper() != "CONNECTIVITY":
                raise ValueError("CONNECTIVITY was expected")
            return self.numbers(size, words[1]), ends[1:]
        self._at = before
        numbers = self.numbers(size, "int")
        starts, at = [], 0
        while at < size:
            starts.append(at)
            at += int(numbers[at]) + 1 if numbers[at] > 0 else size + 1
        if at != size or len(starts) != count:
            raise ValueError(f"{count} cells in {size} numbers were expected")
        corners = np.delete(numbers, starts)
        return corners, np.append(np.array(starts[1:], dtype=np.int64), size)[: len(starts)] - np.arange(
            1, len(starts) + 1
        )
