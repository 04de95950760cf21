"""VTK's formats of a PolyData and of an unstructured grid: the legacy one (.vtk) as text or binary, and XML (.vtp,
.vtu) in every encoding but LZ4.

Readers of our own: of the files that VTK 9 and 3D Slicer write meshio 5.3 refuses PolyData and strings,
trimesh 5.2 passes .vtk to meshio and has no reader for .vtp, and VTK itself is a package of 250 MB.
"""

from __future__ import annotations

import base64
import lzma
import re
import zlib
from collections.abc import Iterator, Mapping
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ..file_access import FormatError, numbers
from .polygons import fans

_TYPES = {
    "float": ">f4", "double": ">f8", "char": ">i1", "unsigned_char": ">u1", "short": ">i2",
    "unsigned_short": ">u2", "int": ">i4", "unsigned_int": ">u4", "long": ">i8", "unsigned_long": ">u8",
    "vtkidtype": ">i8", "vtktypeint32": ">i4", "vtktypeint64": ">i8", "vtktypeuint32": ">u4",
    "vtktypeuint64": ">u8", "signed_char": ">i1",
}  # fmt: skip


def read_vtk(content: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles; cell, point and field data are passed over.

    Raises:
        FormatError: another kind of data set, triangle strips, or fewer numbers than it says.
    """
    points, faces = np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
    file = _opened(content, "POLYDATA", "extract the surface")
    for name, words in file.sections():
        if name == "POINTS":
            points = file.numbers(int(words[1]), words[2], 3)
        elif name in ("VERTICES", "LINES", "POLYGONS", "TRIANGLE_STRIPS"):
            corners, ends = file.cells(int(words[1]), int(words[2]))
            if name == "TRIANGLE_STRIPS":
                raise FormatError("it has triangle strips; triangulate it")
            if name == "POLYGONS":
                faces = fans(corners, ends)
        elif name in ("POINT_DATA", "CELL_DATA"):
            break
        else:
            raise FormatError(f"{words[0][:20]!r} was not expected")
    return points, faces


def read_vtk_grid(content: bytes) -> Any:
    """An unstructured grid as a meshio.Mesh: points, cells of the first order, and the data of both.

    Raises:
        FormatError: another kind of data set, cells of another kind, or fewer numbers than it says.

    A reader of our own: meshio 5.3 fails at the field data and the METADATA that VTK 9 and ParaView write.
    """
    file = _opened(content, "UNSTRUCTURED_GRID", "write it as one")
    arrays: dict[str, np.ndarray] = {}
    data: dict[str, dict[str, np.ndarray]] = {"POINT_DATA": {}, "CELL_DATA": {}}
    place, count = data["POINT_DATA"], 0
    for name, words in file.sections():
        if name == "POINTS":
            arrays["points"] = file.numbers(int(words[1]), words[2], 3).astype(np.float64)
        elif name == "CELLS":
            arrays["corners"], arrays["ends"] = file.cells(int(words[1]), int(words[2]))
        elif name == "CELL_TYPES":
            arrays["types"] = file.numbers(int(words[1]), "int")
        elif name in data:
            place, count = data[name], int(words[1])
            file.place = place
        elif name == "SCALARS":
            size = int(words[3]) if len(words) > 3 else 1
            if not file.line().upper().startswith("LOOKUP_TABLE"):
                raise FormatError("LOOKUP_TABLE was expected")
            place[words[1]] = file.numbers(count, words[2], size)
        elif name in ("VECTORS", "NORMALS", "TENSORS"):
            place[words[1]] = file.numbers(count, words[2], 9 if name == "TENSORS" else 3)
        else:
            raise FormatError(f"{words[0][:20]!r} was not expected")
    if missing := {"points", "corners", "types"} - arrays.keys():
        raise FormatError(f"it has no {min(missing)}")
    return _meshio_mesh(**arrays, point_data=data["POINT_DATA"], cell_data=data["CELL_DATA"])


def _meshio_mesh(
    points: np.ndarray,
    corners: np.ndarray,
    ends: np.ndarray,
    types: np.ndarray,
    point_data: Any,
    cell_data: Mapping[str, np.ndarray],
    field_data: Any = None,
) -> Any:
    """The mesh of cells whose corners stand one after the other, each up to its end."""
    import meshio  # heavy

    for values, length in ((point_data, len(points)), (cell_data, len(types))):
        for name, array in values.items():
            if len(array) != length:
                raise FormatError(f"{name!r} has {len(array)} rows, {length} were expected")
    if not (len(ends) == len(types) and (np.diff(ends, prepend=0) >= 0).all() and ends[-1:].sum() == len(corners)):
        raise FormatError(f"the {len(types)} cells do not fit the {len(corners)} corners")
    tables: Any = meshio
    sizes, cells, numbers = np.diff(ends, prepend=0), list[Any](), list[np.ndarray]()
    for kind in np.unique(types):
        rows = np.flatnonzero(types == kind)
        name = tables._vtk_common.vtk_to_meshio_type.get(int(kind), "")
        size = tables._mesh.num_nodes_per_cell.get(name)
        if size is None or (sizes[rows] != size).any():
            raise FormatError(f"its cells of type {kind} are not read; mesh with tetrahedra")
        cells.append((name, corners[(ends[rows] - size)[:, None] + np.arange(size)]))
        numbers.append(rows)
    of_cells: Any = {name: [values[some] for some in numbers] for name, values in cell_data.items()}
    return meshio.Mesh(points, cells, point_data=point_data, cell_data=of_cells, field_data=field_data)


def _opened(content: bytes, dataset: str, cure: str) -> _File:
    """A file, read as far as its kind of data set."""
    file = _File(content)
    if not file.line().startswith("# vtk DataFile Version"):
        raise FormatError("it does not begin as a VTK file")
    file.line(blank=True)  # its title
    kind = file.line().upper()
    if kind not in ("ASCII", "BINARY"):
        raise FormatError(f"its third line must be ASCII or BINARY, not {kind[:20]!r}")
    file.binary = kind == "BINARY"
    stated = file.line().upper().split()
    if stated != ["DATASET", dataset]:
        raise FormatError(f"it must hold {dataset}, not {' '.join(stated)[:40]!r}; {cure}")
    return file


class _File:
    """The bytes of a file and the place reading has come to."""

    def __init__(self, content: bytes) -> None:
        self._content, self._at = content, 0
        self.binary = False
        self._columns = 1
        """Of the array before; METADATA names each of them."""
        self.place: dict[str, np.ndarray] | None = None
        """Where the arrays of FIELD go; they are passed over where it is None."""

    def sections(self) -> Iterator[tuple[str, list[str]]]:
        """The name and the words of each section but METADATA and FIELD, which are read here."""
        while words := self.line().split():
            name = words[0].upper()
            if name == "METADATA":
                self._metadata()
            elif name == "FIELD":
                self._field(int(words[2]))
            else:
                yield name, words

    def _field(self, arrays: int) -> None:
        """The arrays of field data, or of the data of points or cells."""
        for _ in range(arrays):
            words = self.line().split()
            if words[0].upper() == "METADATA":
                self._metadata()
                words = self.line().split()
            name, size, count, kind = words
            if kind.lower() == "string":
                self._strings(int(size) * int(count))
                continue
            values = self.numbers(int(count), kind, int(size))
            if self.place is not None:
                self.place[name] = values

    def _metadata(self) -> None:
        """Passes over the description of the last array, up to a blank line; names of its columns may be blank."""
        while text := self.line(blank=True):
            if text.upper() == "COMPONENT_NAMES":
                for _ in range(self._columns):
                    self.line(blank=True)

    def _strings(self, count: int) -> None:
        """Passes over strings: lines of a text, or letters after their number, whose first two bits say in how
        many bytes it stands."""
        for _ in range(count):
            if not self.binary:
                self.line(blank=True)
                continue
            width = {3: 1, 2: 2, 1: 4, 0: 8}[self._content[self._at] >> 6]
            number = int.from_bytes(self._content[self._at : self._at + width], "big")
            self._at += width + (number & ((1 << (8 * width - 2)) - 1))

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

    def numbers(self, rows: int, kind: str, columns: int = 1) -> np.ndarray:
        """The next numbers, of a type of VTK, shape (rows,), or (rows, columns) where there are several."""
        values = self._numbers(rows * columns, kind)
        self._columns = columns
        return values if columns == 1 else values.reshape(rows, columns)

    def _numbers(self, count: int, kind: str) -> np.ndarray:
        if kind.lower() not in _TYPES:
            raise FormatError(f"numbers of type {kind[:20]!r} are not read")
        dtype = np.dtype(_TYPES[kind.lower()])
        if not 0 <= count <= len(self._content) - self._at + 1:  # a number takes a byte at least
            raise FormatError(f"it says {count} numbers, {len(self._content) - self._at} bytes are left")
        if self.binary:
            values = np.frombuffer(self._content, dtype, count, self._at)
            self._at += count * dtype.itemsize
            return values.astype(dtype.newbyteorder("="))
        words: list[str] = []
        while len(words) < count and (line := self.line()):
            words += line.split()
        if len(words) != count:
            raise FormatError(f"{count} numbers were expected, not {len(words)}")
        return numbers(words).astype(dtype.newbyteorder("="))

    def cells(self, count: int, size: int) -> tuple[np.ndarray, np.ndarray]:
        """The corners of the next cells, and where each cell ends among them."""
        before = self._at
        words = self.line().split()
        if words and words[0].upper() == "OFFSETS":  # since version 5.1
            ends = self.numbers(count, words[1])
            words = self.line().split()
            if not words or words[0].upper() != "CONNECTIVITY":
                raise FormatError("CONNECTIVITY was expected")
            return self.numbers(size, words[1]), ends[1:]
        self._at = before
        numbers = self.numbers(size, "int")
        starts, at = [], 0
        while at < size:
            starts.append(at)
            at += int(numbers[at]) + 1 if numbers[at] > 0 else size + 1
        if at != size or len(starts) != count:
            raise FormatError(f"{count} cells in {size} numbers were expected")
        corners = np.delete(numbers, starts)
        return corners, np.append(np.array(starts[1:], dtype=np.int64), size)[: len(starts)] - np.arange(
            1, len(starts) + 1
        )


_MOST_BYTES = 2_000_000_000
"""An array is never unpacked to more than this [bytes]."""
_BLANKS = re.compile(rb"\s+")
_CELLS = ("connectivity", "offsets", "types")
"""Arrays of the cells of a grid."""


def read_vtp(content: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of all pieces; cell and point data are passed over.

    Raises:
        FormatError: another kind of data set, triangle strips, or fewer numbers than it says.
    """
    root, arrays = _xml(content, "PolyData")
    points, faces, count = [np.empty((0, 3))], [np.empty((0, 3), dtype=np.int64)], 0
    for piece in root.iterfind("PolyData/Piece"):
        if int(piece.get("NumberOfStrips", "0")):
            raise FormatError("it has triangle strips; triangulate it")
        own = arrays.read(piece, "Points/DataArray").reshape(-1, 3)
        if len(own) != int(piece.get("NumberOfPoints", "-1")):
            raise FormatError(f"a piece says {piece.get('NumberOfPoints')} points and has {len(own)}")
        polygons = int(piece.get("NumberOfPolys", "0"))
        if polygons:
            ends = arrays.read(piece, "Polys/DataArray[@Name='offsets']")
            if len(ends) != polygons:
                raise FormatError(f"a piece says {polygons} polygons and has {len(ends)}")
            corners = arrays.read(piece, "Polys/DataArray[@Name='connectivity']")
            if corners.size and not (corners.min() >= 0 and corners.max() < len(own)):
                raise FormatError(f"a polygon names vertices {corners.min()} to {corners.max()} of {len(own)}")
            faces.append(fans(corners.astype(np.int64), ends) + count)
        points.append(own)
        count += len(own)
    return np.concatenate(points), np.concatenate(faces)


def read_vtu(content: bytes) -> Any:
    """An unstructured grid as a meshio.Mesh: points, cells of the first order, and the numbers of all its data.

    Raises:
        FormatError: another kind of data set, several pieces, cells of another kind, or missing numbers.
    """
    root, arrays = _xml(content, "UnstructuredGrid", "write a grid of tetrahedra")
    pieces = [piece for piece in root.iterfind("UnstructuredGrid/Piece") if piece.get("NumberOfPoints") != "0"]
    if len(pieces) != 1:
        raise FormatError(f"it has {len(pieces)} pieces; join them into one, in ParaView by Clean to Grid")
    (piece,) = pieces
    points, corners, ends, types = (
        arrays.read(piece, path)
        for path in ("Points/DataArray", *(f"Cells/DataArray[@Name='{name}']" for name in _CELLS))
    )
    return _meshio_mesh(
        points.reshape(-1, 3).astype(np.float64),
        corners.astype(np.int64),
        ends.astype(np.int64),
        types,
        arrays.columns(piece.find("PointData")),
        arrays.columns(piece.find("CellData")),
        arrays.columns(root.find("UnstructuredGrid/FieldData")),
    )


def xml_text(content: bytes, name: str) -> list[str]:
    """The strings of an array of field data; FormatError where it is damaged."""
    root, arrays = _xml(content, None)
    texts = root.findall(f".//FieldData/Array[@Name='{name}']") + root.findall(
        f".//FieldData/DataArray[@Name='{name}']"
    )
    return [
        bytes(arrays.numbers(array).astype(np.uint8).tolist()).rstrip(b"\0").decode("latin-1") for array in texts
    ]


def _xml(
    content: bytes, kind: str | None, cure: str = "extract the surface"
) -> tuple[ElementTree.Element, _Arrays]:
    """The tree of a file, of a kind of data set where one is given, and its arrays."""
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise FormatError("it defines entities, which no surface needs")
    raw = re.search(rb'<AppendedData[^>]*encoding\s*=\s*["\']raw["\'][^>]*>\s*_', content)
    appended = b""
    if raw:  # bytes that are no XML
        end = content.rfind(b"</AppendedData>")
        appended = content[raw.end() : end]
        content = content[: raw.end()] + content[end:]
    root = ElementTree.fromstring(content)
    if root.tag != "VTKFile" or (kind and root.get("type") != kind):
        raise FormatError(f"it must hold {kind}, not {root.get('type')!r}; {cure}")
    appended_data = root.find("AppendedData")
    if appended_data is not None and not raw:
        appended = _BLANKS.sub(b"", (appended_data.text or "").encode("ascii"))[1:]
    return root, _Arrays(root, appended, raw is not None)


class _Arrays:
    """How the numbers of a file are packed."""

    def __init__(self, root: ElementTree.Element, appended: bytes, raw: bool) -> None:
        self._order = ">" if root.get("byte_order") == "BigEndian" else "<"
        self._header = np.dtype(self._order + {"UInt64": "u8", "UInt32": "u4"}[root.get("header_type", "UInt32")])
        self._packer = root.get("compressor")
        self._appended, self._raw = appended, raw

    def read(self, piece: ElementTree.Element, path: str) -> np.ndarray:
        """The numbers of an array of a piece."""
        array = piece.find(path)
        if array is None:
            raise FormatError(f"a piece has no {path}")
        return self.numbers(array)

    def columns(self, data: ElementTree.Element | None) -> dict[str, np.ndarray]:
        """The arrays of numbers of an element by their names."""
        arrays: dict[str, np.ndarray] = {}
        for array in () if data is None else data.iterfind("DataArray"):
            if array.get("type") != "String":
                values, columns = self.numbers(array), int(array.get("NumberOfComponents") or 1)
                arrays[array.get("Name", "")] = values if columns == 1 else values.reshape(-1, columns)
        return arrays

    def numbers(self, array: ElementTree.Element) -> np.ndarray:
        """The numbers of an array; the letters of a string."""
        text = (array.text or "").strip()
        kind = re.fullmatch(r"(Float|U?Int)(8|16|32|64)", array.get("type", "").replace("String", "UInt8"))
        if kind is None:
            raise FormatError(f"numbers of type {array.get('type')!r} are not known")
        letter = {"Float": "f", "Int": "i", "UInt": "u"}[kind[1]]
        dtype = np.dtype(f"{self._order}{letter}{int(kind[2]) // 8}")
        if array.get("format") == "ascii":
            return numbers(text.split()).astype(dtype.newbyteorder("="))
        if array.get("format") == "appended":
            content, raw = self._appended[int(array.get("offset", "0")) :], self._raw
        else:
            content, raw = _BLANKS.sub(b"", text.encode("ascii")), False
        unpacked = self._plain(content, raw) if self._packer is None else self._unpacked(content, raw)
        return np.frombuffer(unpacked, dtype).astype(dtype.newbyteorder("="))

    def _plain(self, content: bytes, raw: bool) -> bytes:
        size = self._header.itemsize
        count = int(np.frombuffer(_bytes(content, size, raw), self._header)[0])
        return _bytes(content, size + count, raw)[size:]

    def _unpacked(self, content: bytes, raw: bool) -> bytes:
        unpack = {"vtkZLibDataCompressor": zlib.decompressobj, "vtkLZMADataCompressor": lzma.LZMADecompressor}
        if self._packer not in unpack:
            raise FormatError(f"it is packed by {self._packer}, which is not read; save it with ZLib, or unpacked")
        size = self._header.itemsize
        blocks, each, last = np.frombuffer(_bytes(content, 3 * size, raw), self._header).tolist()
        if max(blocks - 1, 0) * each + (last or each) > _MOST_BYTES or blocks * size > len(content):
            raise FormatError(f"an array says {blocks} blocks of {each} bytes, more than any surface has")
        packed = np.frombuffer(_bytes(content, (3 + blocks) * size, raw), self._header)[3:].tolist()
        head = (3 + blocks) * size
        content = content[head if raw else -(-head // 3) * 4 :]
        data, at, parts = _bytes(content, sum(packed), raw), 0, []
        for number, length in enumerate(packed):
            said = last if number == blocks - 1 and last else each
            part = unpack[self._packer]().decompress(data[at : at + length], said + 1)
            if len(part) != said:
                raise FormatError(f"a block of {said} bytes was expected, not of {len(part)}")
            parts.append(part)
            at += length
        return b"".join(parts)


def _bytes(content: bytes, count: int, raw: bool) -> bytes:
    """The first bytes of what is written, as they are or in base 64."""
    letters = count if raw else -(-count // 3) * 4
    data = content[:letters] if raw else base64.b64decode(content[:letters], validate=True)
    if len(data) < count:
        raise FormatError(f"an array of {count} bytes was expected, {len(data)} are left")
    return data[:count]
