"""From a file or a folder to labels or a scan.

SimpleITK reads NRRD, segmentations of 3D Slicer and folders of DICOM; nibabel reads NIfTI; highdicom reads
segmentation objects of DICOM, which are known by their content. SimpleITK 2.5 loses
data of NIfTI without an error: it fills a file that is cut off with zeros, ignores the lengths of axes in the
sform, accepts a file that does not state its orientation, and does not return the names of labels. It also
refuses the sheared grid of a tilted gantry. MetaImage is not read: a damaged header of one ends the process.

Peak memory for 512 x 512 x 900 voxels: labels in NIfTI 0.3 GB (float64: 0.4), in NRRD 0.65 GB, in NRRD with
four layers 2.1 GB; a CT in NIfTI 0.6 GB, in NRRD 1.2 GB, in DICOM 1.2 GB.
"""

from __future__ import annotations

import math
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from warp_trunk.errors import InputError

from ..file_access import MOST_SURFACE, FormatError, check_file, parsing
from .dicom_seg import is_dicom, open_segmentation
from .image import Image, Stored

ENDINGS = (".nii", ".nii.gz", ".nrrd")
"""Endings of the files that are read; `.seg.nrrd` is one of `.nrrd`."""
_MOST_VOXELS = 1_000_000_000
"""No label map or scan has more; 512 x 512 x 900 are 236 millions."""
_ROUNDED, _PADDING = 0.01, -1
"""Resampled or scaled labels are whole numbers within this; and what surrounds some images."""
_MOST_LABEL = 65535
_SLAB = 4_000_000
"""Voxels converted at a time."""


def image_ending(path: Path) -> str | None:
    """The ending by which a file is known as an image; None where it is none."""
    return next((ending for ending in ENDINGS if path.name.lower().endswith(ending)), None)


def image_stem(path: Path) -> str:
    """The name of an image file without its ending."""
    return path.name[: -len(image_ending(path) or "") or None].removesuffix(".seg")


def read_labels(path: Path) -> Image:
    """Read a label map.

    Raises:
        InputError: the file is missing, damaged or no label map, or the extra `images` is not installed.
    """
    return _read(path, scan=False)


def read_scan(path: Path) -> Image:
    """Read a CT in Hounsfield units, a file or a folder of DICOM; InputError as `read_labels`."""
    return _read(path, scan=True)


def _read(path: Path, scan: bool) -> Image:
    what = "a CT" if scan else "a label map"
    if scan and path.is_dir():
        size = sum(file.stat().st_size for file in path.iterdir() if file.is_file())
    else:
        size = check_file(path, f"{what} ({', '.join(ENDINGS)}) was expected", MOST_SURFACE)
        if image_ending(path) is None and (scan or not is_dicom(path)):
            raise InputError(
                f"{path}: cannot be read as {what} ('{path.suffix}' is not known); use {', '.join(ENDINGS)}"
            )
    if not (find_spec("nibabel") and find_spec("SimpleITK") and find_spec("highdicom")):
        raise InputError(
            f"{path}: needs packages that are not installed; pip install 'warp-trunk[images]' "
            "(in a clone: uv sync --extra images)"
        )
    from .nifti import open_nifti
    from .simpleitk import open_nrrd, open_series

    with parsing(path, what, size):
        if path.is_dir():
            return _converted(path, open_series(path), scan)
        if path.name.lower().endswith((".nii", ".nii.gz")):
            with open_nifti(path) as stored:
                return _converted(path, stored, scan)
        if image_ending(path) is None:
            return _converted(path, open_segmentation(path), scan)
        return _converted(path, open_nrrd(path), scan)


def _converted(path: Path, stored: Stored, scan: bool) -> Image:
    """The image in the smallest type, converted slab by slab, so that no second copy of the whole is made."""
    shape = stored.shape
    if len(shape) not in (3, 4) or (len(shape) == 4 and scan):
        raise FormatError(f"it has {len(shape)} dimensions, {' x '.join(map(str, shape))}; give a volume of 3")
    check_grid(path, shape[-3:], stored.affine)
    if math.prod(shape) > _MOST_VOXELS:
        raise FormatError(f"its header gives {math.prod(shape):.2g} voxels, {_MOST_VOXELS:.0e} is the most")
    for names in stored.names:
        odd = next((name for name in names.values() if not name.isprintable()), None)
        if odd is not None:
            raise InputError(f"{path}: {odd[:40]!r} names a label and cannot be printed; rename it")
    i, j, k = shape[-3:]
    storage = np.empty((math.prod(shape[:-3]), k, j, i), dtype=np.int16 if scan else np.uint8)
    step = max(1, _SLAB // math.prod(shape[:-1]))
    for first in range(0, k, step):
        part = slice(first, min(first + step, k))
        slab = _hounsfield(stored.slabs(part)) if scan else _labels(stored.slabs(part))
        if not np.can_cast(slab.dtype, storage.dtype):
            storage = storage.astype(slab.dtype)
        storage[:, part] = slab.reshape(-1, *slab.shape[-3:]).transpose(0, 3, 2, 1)
    return Image(storage.transpose(0, 3, 2, 1), stored.affine, stored.names, stored.notes, stored.meanings)


def _labels(slab: np.ndarray) -> np.ndarray:
    """Labels as the smallest type that holds them; FormatError for numbers that are no labels."""
    if slab.dtype.kind not in "iuf":
        raise FormatError(f"its voxels are of the type {slab.dtype}, and only numbers are read")
    whole = np.rint(slab) if slab.dtype.kind == "f" else slab
    odd = slab[~(np.abs(slab - whole) <= _ROUNDED)] if whole is not slab else np.empty(0)  # nor is NaN
    if odd.size:
        raise FormatError(
            f"labels are whole numbers, and it holds {odd[0]:g}; give the label map, not probabilities or the "
            "scan itself"
        )
    low, high = whole.min(), whole.max()
    if low == _PADDING:
        low, whole = 0, np.maximum(whole, 0)
    if low < 0 or high > _MOST_LABEL:
        raise FormatError(
            f"labels are from 0 to {_MOST_LABEL}, and it holds {low if low < 0 else high:g}; give the label map, "
            "not the scan itself (that is --ct)"
        )
    return whole.astype(np.uint8 if high < 256 else np.uint16)


def _hounsfield(slab: np.ndarray) -> np.ndarray:
    """Hounsfield units as whole numbers of 16 bits; what is not a number is air."""
    return np.rint(np.clip(np.nan_to_num(slab, nan=-1024.0), -32768, 32767)).astype(np.int16)


VOXEL = (0.1, 12.0)
"""How long the sides of a voxel may be [mm]."""
LARGEST = 2500.0
"""No scan of a patient reaches further than this along one axis of its grid [mm]."""
_SLANT = 0.7
"""Volume of a voxel over the product of its sides: 1 where they are at right angles. A tilted gantry of 30
degrees, more than any scanner's, gives 0.87."""


def check_grid(path: Path, shape: tuple[int, ...], affine: np.ndarray) -> None:
    """Check the affine of a file.

    Args:
        path: the file, for the message.
        shape: voxels along the three axes.
        affine: from voxels to patient axes [mm], shape (4, 4).

    Raises:
        InputError: an affine that is not finite or has no inverse, or voxels or a grid of a size that no scan has.
    """
    if min(shape) < 2:
        raise InputError(
            f"{path}: has {_times(shape)} voxels, and a label map needs 2 along each axis; give the whole"
        )
    matrix = affine[:3, :3]
    if not np.isfinite(affine).all():
        raise InputError(
            f"{path}: its affine must be finite, it is {affine[:3].round(3).tolist()}; write it again"
        )
    sides = np.linalg.norm(matrix, axis=0)
    low, high = VOXEL
    if not ((sides >= low) & (sides <= high)).all():
        raise InputError(
            f"{path}: voxels must be {low:g} to {high:g} mm long, these are {_times(sides)} mm; write "
            "the file with its spacing in mm, not in m, cm or micrometres"
        )
    if abs(np.linalg.det(matrix)) < _SLANT * sides.prod():
        raise InputError(
            f"{path}: the axes of its affine lie nearly in one plane ({matrix.round(3).tolist()}); write it again"
        )
    extent = sides * shape
    if extent.max() > LARGEST or np.abs(affine[:3, 3]).max() > 1e5:
        raise InputError(
            f"{path}: reaches over {_times(extent)} mm from {affine[:3, 3].round(1).tolist()}, and a scan over "
            f"{LARGEST:g} mm at most; look at its spacing and origin"
        )


def _times(numbers: np.ndarray | tuple[int, ...]) -> str:
    return " x ".join(f"{number:.4g}" for number in numbers)
