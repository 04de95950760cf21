"""A CT as the folder of DICOM files that a scanner writes, read by SimpleITK."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.errors import InputError

from ..file_access import reason
from .grid_checks import check_grid
from .image import Image

_UNEVEN = 0.1
"""Steps from slice to slice may differ by this [mm]; positions are written with a few digits."""


def read_series(folder: Path) -> Image:
    """The CT of a folder in Hounsfield units, which has one series of parallel slices of equal distance.

    Raises:
        InputError: there is no series or more than one, it is no CT, a slice is missing, damaged or of another
            size.
    """
    import SimpleITK  # heavy

    SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
    reader: Any = SimpleITK.ImageSeriesReader()
    series = reader.GetGDCMSeriesIDs(str(folder))
    if len(series) != 1:
        raise InputError(
            f"{folder}: one DICOM series was expected, {len(series)} are there; give the folder of the CT alone"
        )
    files = reader.GetGDCMSeriesFileNames(str(folder), series[0])
    damaged = {path.name for path in folder.iterdir() if _is_dicom(path)} - {Path(file).name for file in files}
    if damaged:  # SimpleITK leaves them out without a word
        raise InputError(
            f"{folder / min(damaged)}: is no whole slice of the series; export it again, or remove it"
        )
    try:
        affine = _affine(SimpleITK, files)
        reader.SetFileNames(files)
        reader.SetOutputPixelType(SimpleITK.sitkInt16)
        values = SimpleITK.GetArrayFromImage(reader.Execute()).T
    except (RuntimeError, ValueError) as error:  # what SimpleITK raises, in many lines
        raise InputError(f"{folder}: cannot be read as a CT ({reason(error)}); export it again") from error
    check_grid(folder, values.shape, affine)
    return Image(values[None], affine, ({},))


def _is_dicom(path: Path) -> bool:
    if path.name == "DICOMDIR" or not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(132)[128:] == b"DICM"


def _affine(package: Any, files: tuple[str, ...]) -> np.ndarray:
    """From voxels to LPS in mm; by the places of the slices, as the gantry may be tilted."""
    header = package.ImageFileReader()
    places, turns, axes = [], [], np.zeros((3, 2))
    for file in files:
        header.SetFileName(file)
        header.ReadImageInformation()
        if header.GetMetaData("0008|0060").strip() != "CT":
            raise ValueError(f"{Path(file).name} is no CT but {header.GetMetaData('0008|0060').strip()}")
        places.append(header.GetOrigin())
        turns.append(header.GetDirection())
        axes = np.reshape(turns[-1], (3, 3))[:, :2] * header.GetSpacing()[:2]
    steps = np.diff(places, axis=0)
    if len(files) < 2 or np.ptp(turns, axis=0).max() > 1e-3:
        raise ValueError(f"its {len(files)} slices are no stack of parallel ones")
    if np.ptp(steps, axis=0).max() > _UNEVEN:
        gaps = np.linalg.norm(steps, axis=1)
        raise ValueError(f"steps from slice to slice are {gaps.min():.2f} to {gaps.max():.2f} mm; one is missing")
    affine = np.eye(4)
    affine[:3, :2], affine[:3, 2], affine[:3, 3] = axes, steps.mean(axis=0), places[0]
    return affine
