"""NRRD, segmentations of 3D Slicer (.seg.nrrd) and folders of DICOM, by SimpleITK."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.errors import InputError

from ..file_access import FormatError
from .dicom_seg import is_dicom
from .image import Stored

_UNEVEN = 0.1
"""Steps from slice to slice may differ by this [mm]; positions are written with a few digits."""
_SPACES = r"(left|right)-(anterior|posterior)-superior|[lr][ap]s"
"""Axes of an NRRD that SimpleITK converts to LPS; it takes any other for LPS without an error."""


def open_nrrd(path: Path) -> Stored:
    """The image of an NRRD; no other file is opened, whatever the header names.

    Raises:
        FormatError: its header names another file, or does not state the orientation, or the segments do not fit.
        RuntimeError: what SimpleITK refuses.
    """
    _check_header(path)
    package = _package()
    try:
        image = package.ReadImage(str(path), imageIO="NrrdImageIO")
    except RuntimeError as error:
        raise RuntimeError(_last_words(error)) from error
    voxels, count = package.GetArrayViewFromImage(image), image.GetNumberOfComponentsPerPixel()
    affine = np.eye(4)
    if image.GetDimension() == 3:
        affine[:3, :3] = np.reshape(image.GetDirection(), (3, 3)) * image.GetSpacing()
        affine[:3, 3] = image.GetOrigin()
    shape = ((count,) if count > 1 else ()) + image.GetSize()
    names = _segments({key: image.GetMetaData(key) for key in image.GetMetaDataKeys()}, count)
    # `image` is captured with the view: its memory is freed with the image
    return Stored(lambda part, _image=image: voxels[part].T, shape, affine, names)


def _check_header(path: Path) -> None:
    """FormatError for a header with which SimpleITK would read another file, or put voxels at a wrong place."""
    with path.open("rb") as file:
        if file.read(4) != b"NRRD":
            raise FormatError("it does not begin as an NRRD")
        text = file.read(1_000_000).replace(b"\r\n", b"\n").partition(b"\n\n")[0].decode("utf-8", "replace")
    header = {
        key.strip().lower(): value.strip() for key, _, value in (line.partition(":") for line in text.split("\n"))
    }
    if {"data file", "datafile"} & set(header):
        raise FormatError("it keeps its voxels in another file, which is not opened; save all in one")
    space, axes = header.get("space", ""), header.get("space directions", "")
    stated = re.fullmatch(_SPACES, space.lower()) and axes
    if header.get("dimension") in ("3", "4") and not stated:
        raise FormatError(
            f"its space is '{space[:40]}' and its space directions are '{axes[:40]}'; save it with both, in LPS "
            "or RAS, so that the patient's left is known"
        )
    units = {unit.strip('"').lower() for unit in header.get("space units", "").split()}
    if units - {"mm", "millimeter", "millimeters", ""}:
        raise FormatError(f"its lengths are in {', '.join(sorted(units))}; save it in mm")


def _segments(header: Mapping[str, str], layers: int) -> tuple[dict[int, str], ...]:
    """By layer, the name of each label: Segment3_Name, Segment3_LabelValue, Segment3_Layer."""
    names: tuple[dict[int, str], ...] = tuple({} for _ in range(layers))
    for number in sorted(int(key[7:-5]) for key in header if re.fullmatch(r"Segment\d{1,6}_Name", key)):
        name = header[f"Segment{number}_Name"]
        old = f"Segment{number}_Layer" not in header  # before Slicer 4.11 each segment was a layer of its own
        layer = number if old and layers > 1 else int(header.get(f"Segment{number}_Layer", 0))
        value = int(header.get(f"Segment{number}_LabelValue", 1 if layers > 1 else number + 1))
        if not 0 <= layer < layers:
            raise FormatError(f"its segment '{name}' is said to be in layer {layer}, there are {layers}")
        if value in names[layer]:
            raise FormatError(f"its segments '{names[layer][value]}' and '{name}' have the same label {value}")
        names[layer][value] = name
    return names


def open_series(folder: Path) -> Stored:
    """The CT of a folder in Hounsfield units, which has one series of parallel slices of equal distance.

    Raises:
        InputError: there is no series or more than one, or a slice is damaged.
        FormatError: it is no CT, a slice is missing or of another direction.
    """
    package = _package()
    reader: Any = package.ImageSeriesReader()
    series = reader.GetGDCMSeriesIDs(str(folder))
    if len(series) != 1:
        raise InputError(
            f"{folder}: one DICOM series was expected, {len(series)} are there; give the folder of the CT alone"
        )
    files = reader.GetGDCMSeriesFileNames(str(folder), series[0])
    damaged = {path.name for path in folder.iterdir() if is_dicom(path)} - {Path(file).name for file in files}
    if damaged:  # SimpleITK leaves them out without an error
        raise InputError(
            f"{folder / min(damaged)}: is no whole slice of the series; export it again, or remove it"
        )
    try:
        affine = _affine(package, files)
        reader.SetFileNames(files)
        reader.SetOutputPixelType(package.sitkInt16)
        image = reader.Execute()
    except RuntimeError as error:
        raise RuntimeError(_last_words(error)) from error
    voxels = package.GetArrayViewFromImage(image)
    return Stored(lambda part, _image=image: voxels[part].T, image.GetSize(), affine)


def _affine(package: Any, files: tuple[str, ...]) -> np.ndarray:
    """From voxels to LPS in mm; by the places of the slices, as the gantry may be tilted."""
    header = package.ImageFileReader()
    places, turns, axes = [], [], np.zeros((3, 2))
    for file in files:
        header.SetFileName(file)
        header.ReadImageInformation()
        if header.GetMetaData("0008|0060").strip() != "CT":
            raise FormatError(f"{Path(file).name} is no CT but {header.GetMetaData('0008|0060').strip()}")
        places.append(header.GetOrigin())
        turns.append(header.GetDirection())
        axes = np.reshape(turns[-1], (3, 3))[:, :2] * header.GetSpacing()[:2]
    steps = np.diff(places, axis=0)
    if len(files) < 2 or np.ptp(turns, axis=0).max() > 1e-3:
        raise FormatError(f"its {len(files)} slices are no stack of parallel ones")
    if np.ptp(steps, axis=0).max() > _UNEVEN:
        raise FormatError(_uneven(steps, np.reshape(turns[0], (3, 3))[:, 2]))
    affine = np.eye(4)
    affine[:3, :2], affine[:3, 2], affine[:3, 3] = axes, steps.mean(axis=0), places[0]
    return affine


def _uneven(steps: np.ndarray, normal: np.ndarray) -> str:
    """The reason why steps from slice to slice (n, 3) differ, and the cure; the normal is that of the slices."""
    along = np.abs(steps @ normal)
    if twice := int((along <= _UNEVEN).sum()):
        return f"{twice} slices lie where another one is; remove the doubled ones, or give one series alone"
    said = f"{along.min():.2f} to {along.max():.2f} mm"
    if np.ptp(along) <= _UNEVEN:
        aside = np.ptp(steps - np.outer(steps @ normal, normal), axis=0).max()
        return (
            f"its slices are {said} apart, but move sideways by steps that differ by {aside:.1f} mm, as of "
            "a gantry tilted during the scan; resample them to a straight stack"
        )
    missing = np.rint(along / np.median(along))
    if np.abs(along - missing * np.median(along)).max() <= _UNEVEN:
        gaps = int((missing - 1.0).sum())
        return f"steps from slice to slice are {said}; {gaps} missing: export the series again"
    return f"steps from slice to slice are {said}; give one reconstruction with equal steps"


def _package() -> Any:
    import SimpleITK  # heavy

    SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
    return SimpleITK


def _last_words(error: RuntimeError) -> str:
    """The last line of an error of SimpleITK, which says the reason; those before name its source files."""
    return str(error).strip().splitlines()[-1]
