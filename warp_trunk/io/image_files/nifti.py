"""NIfTI: one file .nii or .nii.gz, with the names of labels where the file's extension gives them."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from .grid_checks import check_grid
from .image import Image
from .slabs import open_packed, read_slabs, to_hounsfield, to_labels

_UNITS = {"mm": 1.0, "meter": 1000.0, "micron": 1e-3, "unknown": 1.0}
_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])
"""From the RAS of NIfTI."""
_AGREE = 1.0
"""Two affines of one file may put a voxel this far apart [mm]."""
_MOST_HEADER = 16_000_000
"""No header with its extensions is longer than this [bytes]."""


def parse_nifti(path: Path, content: bytes, scan: bool) -> Image:
    """Labels, or the Hounsfield units of a scan.

    Args:
        path: for messages.
        content: the whole file.
        scan: whether it is a scan.

    Raises:
        InputError: a grid that cannot be that of a patient.
        Exception: of many kinds, where the content is no NIfTI.
    """
    packed = content[:2] == b"\x1f\x8b"
    stream = open_packed(content, packed)
    header = _header(stream)
    shape = tuple(int(n) for n in header.get_data_shape())
    while len(shape) > 3 and shape[-1] == 1:
        shape = shape[:-1]
    if len(shape) != 3:
        raise ValueError(
            f"it has {len(shape)} dimensions, {' x '.join(map(str, shape))}, and 3 are read; give one of them"
        )
    affine, notes = _affine(header, shape)
    check_grid(path, shape, affine)
    offset = int(header.get_data_offset())
    slope, intercept = header.get_slope_inter()
    if not scan and (slope not in (None, 1.0) or intercept not in (None, 0.0)):
        raise ValueError(
            f"labels have no scale, and it says {slope} and {intercept}; give the label map, not the scan"
        )
    convert = to_hounsfield(slope or 1.0, intercept or 0.0) if scan else to_labels
    stream.seek(offset)
    left = len(content) - (0 if packed else offset)
    values = read_slabs(stream, shape, header.get_data_dtype(), left, packed=packed, convert=convert)
    return Image(values[None], affine, (_names(header),), notes)


def _header(stream: Any) -> Any:
    from nibabel.nifti1 import Nifti1Header  # heavy
    from nibabel.nifti2 import Nifti2Header

    start = stream.read(4)
    stream.seek(0)
    two = int.from_bytes(start, "little") == 540 or int.from_bytes(start, "big") == 540
    kind = Nifti2Header if two else Nifti1Header
    size = 540 if two else 348
    bare = kind(stream.read(size), check=False)
    if bytes(bare["magic"])[:3] not in (b"n+1", b"n+2"):
        raise ValueError("it does not begin as a NIfTI of one file (.nii, .nii.gz)")
    if not size <= int(bare["vox_offset"]) <= _MOST_HEADER:
        raise ValueError(f"its voxels are said to begin at byte {int(bare['vox_offset'])}")
    stream.seek(0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # extensions of odd lengths
        return kind.from_fileobj(stream)


def _affine(header: Any, shape: tuple[int, ...]) -> tuple[np.ndarray, tuple[str, ...]]:
    """From voxels to LPS in mm, and what is doubtful about it."""
    by_s, by_q = header.get_sform(coded=True)[0], header.get_qform(coded=True)[0]
    if by_s is None and by_q is None:
        raise ValueError(
            "it says neither by sform nor by qform where the patient's left is; write it again with its "
            "orientation"
        )
    affine = by_q if by_s is None else by_s
    notes: list[str] = []
    if by_s is not None and by_q is not None:
        corner = np.array([*shape, 1.0])
        apart = max(np.abs((by_s - by_q) @ corner)[:3].max(), np.abs(by_s - by_q)[:3, 3].max())
        if apart > _AGREE:
            notes.append(
                f"its sform and its qform put voxels {apart:.0f} mm apart; the sform is used, look "
                "whether that is right"
            )
    unit = header.get_xyzt_units()[0]
    if unit not in _UNITS:
        raise ValueError(f"its lengths are in '{unit}'; write it in mm")
    return _LPS @ np.diag([_UNITS[unit]] * 3 + [1.0]) @ affine, tuple(notes)


def _names(header: Any) -> dict[int, str]:
    """Names of labels in the XML that Connectome Workbench and TotalSegmentator write behind the header."""
    for extension in header.extensions:
        if extension.get_code() not in (0, 6, 30):
            continue
        content = extension.get_content()
        text = content.decode("utf-8", "replace") if isinstance(content, bytes) else str(content)
        text = text.rstrip("\x00 \n")
        if "<Label " not in text:
            continue
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise ValueError("the names of its labels define entities, which no table needs")
        return {
            int(label.attrib["Key"]): (label.text or "").strip()
            for label in ElementTree.fromstring(text).iter("Label")
        }
    return {}
