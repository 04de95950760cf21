"""NRRD: label maps, scans, and segmentations of 3D Slicer (.seg.nrrd), whose segments may overlap."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from .grid_checks import check_grid
from .image import Image
from .slabs import open_packed, read_slabs, to_hounsfield, to_labels

_SPACES = {
    "left-posterior-superior": (1.0, 1.0, 1.0),
    "lps": (1.0, 1.0, 1.0),
    "right-anterior-superior": (-1.0, -1.0, 1.0),
    "ras": (-1.0, -1.0, 1.0),
    "left-anterior-superior": (1.0, -1.0, 1.0),
    "las": (1.0, -1.0, 1.0),
}
"""Signs that take a space of NRRD to LPS."""
_TYPES = {
    **dict.fromkeys(("signed char", "int8", "int8_t"), "i1"),
    **dict.fromkeys(("uchar", "unsigned char", "uint8", "uint8_t"), "u1"),
    **dict.fromkeys(("short", "short int", "signed short", "signed short int", "int16", "int16_t"), "i2"),
    **dict.fromkeys(("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"), "u2"),
    **dict.fromkeys(("int", "signed int", "int32", "int32_t"), "i4"),
    **dict.fromkeys(("uint", "unsigned int", "uint32", "uint32_t"), "u4"),
    "float": "f4",
    "double": "f8",
}
_PACKED = {"raw": False, "gzip": True, "gz": True}
_MOST_LAYERS = 300


def parse_nrrd(path: Path, content: bytes, scan: bool) -> Image:
    """Labels, or the Hounsfield units of a scan; no other file is opened, whatever the header names.

    Args:
        path: for messages.
        content: the whole file.
        scan: whether it is a scan.

    Raises:
        InputError: a grid that cannot be that of a patient.
        Exception: of many kinds, where the content is no NRRD.
    """
    header, start = _header(content)
    kind = _TYPES.get(str(header.get("type")))
    if kind is None:
        raise ValueError(f"its voxels are of the type '{header.get('type')}', and numbers are read only")
    if header.get("encoding") not in _PACKED:
        raise ValueError(f"it is encoded as '{header.get('encoding')}'; save it with gzip, or raw")
    packed = _PACKED[header["encoding"]]
    shape = tuple(int(n) for n in header["sizes"])
    if len(shape) not in (3, 4) or (len(shape) == 4 and (scan or shape[0] > _MOST_LAYERS)):
        raise ValueError(
            f"it has {len(shape)} dimensions, {' x '.join(map(str, shape))}, and 3 are read; give one of them"
        )
    affine = _affine(header, len(shape) == 4)
    check_grid(path, shape[-3:], affine)
    order = "<" if header.get("endian", "little") == "little" else ">"
    body = content[start:]
    convert = to_hounsfield(1.0, 0.0) if scan else to_labels
    stream, voxel = open_packed(body, packed), np.dtype(order + kind)
    values = read_slabs(stream, shape, voxel, len(body), packed=packed, convert=convert)
    values = values if len(shape) == 4 else values[None]
    return Image(values, affine, _names(header, len(values)))


def _header(content: bytes) -> tuple[Any, int]:
    """What the header says, and where the voxels begin."""
    import io

    import nrrd  # heavy

    if content[:4] != b"NRRD":
        raise ValueError("it does not begin as an NRRD")
    stream = io.BytesIO(content)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # fields given twice
        header = nrrd.read_header(stream)
    if {"data file", "datafile"} & set(header):
        raise ValueError("it keeps its voxels in another file, which is not opened; save all in one")
    if any(int(header.get(key, 0)) for key in ("byte skip", "byteskip", "line skip", "lineskip")):
        raise ValueError("it skips bytes or lines before its voxels; save it again")
    return header, stream.tell()


def _affine(header: Any, layered: bool) -> np.ndarray:
    space = str(header.get("space", "")).lower()
    if space not in _SPACES:
        raise ValueError(
            f"it says '{space}' for its space; save it in LPS or RAS, so that the patient's left is known"
        )
    units = {str(unit).strip('"').lower() for unit in header.get("space units", ())}
    if units - {"mm", "millimeter", "millimeters", ""}:
        raise ValueError(f"its lengths are in {', '.join(sorted(units))}; save it in mm")
    directions = np.asarray(header["space directions"], dtype=np.float64)
    directions = directions[1:] if layered else directions
    if directions.shape != (3, 3):
        raise ValueError(f"its space directions have the shape {directions.shape}, 3 x 3 are needed")
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = directions.T, np.asarray(header["space origin"], dtype=np.float64)
    return np.diag([*_SPACES[space], 1.0]) @ affine


def _names(header: Any, layers: int) -> tuple[dict[int, str], ...]:
    """By layer, the name of each label: Segment3_Name, Segment3_LabelValue, Segment3_Layer."""
    names: tuple[dict[int, str], ...] = tuple({} for _ in range(layers))
    for number in range(_MOST_LAYERS * 4):
        name = header.get(f"Segment{number}_Name")
        if name is None:
            break
        old = f"Segment{number}_Layer" not in header  # before Slicer 4.11 each segment was a layer of its own
        layer = number if old and layers > 1 else int(header.get(f"Segment{number}_Layer", 0))
        value = int(header.get(f"Segment{number}_LabelValue", 1 if layers > 1 else number + 1))
        if not 0 <= layer < layers:
            raise ValueError(f"its segment '{name}' is said to be in layer {layer}, there are {layers}")
        if value in names[layer]:
            raise ValueError(f"its segments '{names[layer][value]}' and '{name}' have the same label {value}")
        names[layer][value] = str(name)
    return names
