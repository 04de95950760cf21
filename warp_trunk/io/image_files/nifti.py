"""NIfTI by nibabel: one file .nii or .nii.gz, with the names of labels where the file's extension has them."""

from __future__ import annotations

import gzip
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ..file_access import FormatError
from .image import Stored

_UNITS = {"mm": 1.0, "meter": 1000.0, "micron": 1e-3, "unknown": 1.0}
_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])
"""From the RAS of NIfTI."""
_ROUNDED = 1e-5
"""A quaternion may be longer than 1 by this: its numbers have 24 bits."""
_AGREE = 1.0
"""Two affines of one file may put a voxel this far apart [mm]."""


@contextmanager
def open_nifti(path: Path) -> Iterator[Stored]:
    """The image of a file, which stays open in the block; a scale of its header is applied.

    Raises:
        Exception: of many kinds, where the content is no NIfTI, is cut off or does not state its orientation.
    """
    from nibabel.nifti1 import Nifti1Image  # heavy
    from nibabel.nifti2 import Nifti2Image

    with path.open("rb") as raw:
        packed = raw.read(2) == b"\x1f\x8b"
        raw.seek(0)
        stream: Any = gzip.GzipFile(fileobj=raw) if packed else raw
        start = stream.read(4)
        stream.seek(0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # extensions of odd lengths
            second = 540 in (int.from_bytes(start, order) for order in ("little", "big"))
            base: Any = Nifti2Image if second else Nifti1Image
            header = type("Header", (base.header_class,), {"quaternion_threshold": _ROUNDED})
            kind: Any = type("Image", (base,), {"header_class": header})
            try:
                image: Any = kind.from_stream(stream)
            except ValueError as error:
                if not str(error).startswith("w2 "):
                    raise
                raise FormatError(
                    "its quaternion is no rotation, and it has no sform; write it with one"
                ) from error
        shape = image.shape
        while len(shape) > 3 and shape[-1] == 1:
            shape = shape[:-1]
        if len(shape) != 3:
            raise FormatError(f"it has {len(shape)} dimensions, {' x '.join(map(str, shape))}; give a volume of 3")
        voxels = image.dataobj
        affine, notes = _affine(image.header, shape)
        rest = (0,) * (image.ndim - 3)

        def slabs(part: slice) -> np.ndarray:
            try:
                return np.asarray(voxels[(..., part, *rest)])
            except (OSError, EOFError, ValueError) as error:
                raise FormatError("it is cut off, or its voxels are damaged") from error

        yield Stored(slabs, shape, affine, (_names(image.header),), notes)
        stream.read(1)  # past the end, where gzip's checksum is verified


def _affine(header: Any, shape: tuple[int, ...]) -> tuple[np.ndarray, tuple[str, ...]]:
    """From voxels to LPS in mm, and what is doubtful about it."""
    from nibabel.spatialimages import HeaderDataError  # heavy

    by_s = header.get_sform(coded=True)[0]
    try:
        by_q = header.get_qform(coded=True)[0]
    except (ValueError, HeaderDataError):  # with an sform nothing needs it
        by_q = None
    if by_s is None and by_q is None:
        raise FormatError("neither its sform nor its qform states where the patient's left is; write it with one")
    affine = by_q if by_s is None else by_s
    notes: list[str] = []
    if by_s is not None and by_q is not None:
        corner = np.array([*shape, 1.0])
        apart = max(np.abs((by_s - by_q) @ corner)[:3].max(), np.abs(by_s - by_q)[:3, 3].max())
        if apart > _AGREE:
            pairs = (("left and right", 0), ("front and back", 1), ("head and feet", 2))
            turned = [
                text for text, row in pairs if by_s[row, (a := np.abs(by_s[row, :3]).argmax())] * by_q[row, a] < 0
            ]
            differ = f", and {' and '.join(turned)} differ" if turned else ""
            notes.append(
                f"its sform and its qform put voxels {apart:.0f} mm apart{differ}; the sform is used, check it"
            )
    unit = header.get_xyzt_units()[0]
    if unit not in _UNITS:
        raise FormatError(f"its lengths are in '{unit}'; write it in mm")
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
            raise FormatError("the names of its labels define entities, which no table needs")
        return {
            int(label.attrib["Key"]): (label.text or "").strip()
            for label in ElementTree.fromstring(text).iter("Label")
        }
    return {}
