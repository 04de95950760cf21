"""From a file to labels or a scan, by the file's ending.

SimpleITK 2.5 reads folders of DICOM only; files are read with nibabel and pynrrd. It reads a NIfTI that is cut off
in the middle, or that does not say where the patient's left is, without an error, and does not hand on the names
of its labels. For 512 x 512 x 900 voxels it takes 3.7 GB for labels as float64, 2.4 GB for a scan with an
intercept, 1.9 GB for four layers of segments and 0.6 GB for labels as uint8, where these take 0.3, 0.6, 1.0 and
0.3 GB here. A CT in DICOM takes 1.1 GB.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from warp_trunk.errors import InputError

from ..file_access import MOST_SURFACE, limited_memory, read_bytes, reason
from .dicom import read_series
from .image import Image
from .nifti import parse_nifti
from .nrrd import parse_nrrd

_READERS = {
    ".nii": (parse_nifti, "nibabel"),
    ".nii.gz": (parse_nifti, "nibabel"),
    ".nrrd": (parse_nrrd, "nrrd"),
}
ENDINGS = tuple(_READERS)
"""Endings of the files that are read; `.seg.nrrd` is one of `.nrrd`."""


def image_ending(path: Path) -> str | None:
    """The ending by which a file is known as an image; None where it is none."""
    return next((ending for ending in (".nii.gz", ".nii", ".nrrd") if path.name.lower().endswith(ending)), None)


def image_stem(path: Path) -> str:
    """The name of an image file without its ending."""
    return path.name[: -len(image_ending(path) or "") or None].removesuffix(".seg")


def read_labels(path: Path) -> Image:
    """Reads a label map.

    Raises:
        InputError: the file is missing, damaged or no label map, or the extra `images` is not installed.
    """
    return _read(path, scan=False)


def read_scan(path: Path) -> Image:
    """Reads a CT in Hounsfield units, a file or a folder of DICOM; InputError as `read_labels`."""
    if path.is_dir():
        _check_installed(path, "SimpleITK", "dicom")
        return read_series(path)
    return _read(path, scan=True)


def _read(path: Path, scan: bool) -> Image:
    what = "a CT" if scan else "a label map"
    content = read_bytes(path, f"{what} ({', '.join(ENDINGS)}) was expected", MOST_SURFACE)
    ending = image_ending(path)
    if ending is None:
        raise InputError(
            f"{path}: cannot be read as {what} ('{path.suffix}' is not known); use {', '.join(ENDINGS)}"
        )
    parse, package = _READERS[ending]
    _check_installed(path, package, "images")
    try:
        with limited_memory(len(content)):
            image = parse(path, content, scan)
    except InputError:
        raise
    except Exception as error:  # each format fails with errors of its own
        raise InputError(f"{path}: cannot be read as {what} ({reason(error)}); write it again") from error
    for names in image.names:
        odd = next((name for name in names.values() if not name.isprintable()), None)
        if odd is not None:
            raise InputError(f"{path}: {odd[:40]!r} names a label and cannot be printed; rename it")
    return image


def _check_installed(path: Path, package: str, extra: str) -> None:
    if find_spec(package) is None:
        raise InputError(
            f"{path}: needs a package that is not installed; pip install 'warp-trunk[{extra}]' "
            f"(in a clone: uv sync --extra {extra})"
        )
