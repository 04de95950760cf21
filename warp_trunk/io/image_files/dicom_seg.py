"""DICOM segmentation objects, as hospitals keep and 3D Slicer and TotalSegmentator write them, by highdicom.

Segments may overlap, so that each goes into the first layer that is free where it is. A frame without a voxel is
mostly left out of the file; the grid of those that are there says where it belongs. Where frames are left out, an
empty slice is added at both ends, or else the first bone would seem to be cut off by the image.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.errors import InputError

from ..file_access import FormatError
from .image import Stored

_PARALLEL = 1e-3
"""Cosines of the axes of frames differ by no more than this."""
_SHIFTED = 0.1
"""Frames lie behind each other within this [mm]; the reader of series allows the same."""
_HALF = 0.5
"""The part of a voxel from which a fractional segment holds it."""


def is_dicom(path: Path) -> bool:
    """Whether a file is one of DICOM, whatever its name, and no directory of others."""
    if path.name == "DICOMDIR" or not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(132)[128:] == b"DICM"


def open_segmentation(path: Path) -> Stored:
    """The segments of a segmentation object as labels, with their names and the meanings of their codes.

    Raises:
        InputError: it is another object, for example a slice of the scan, has no segment, or its frames are not
            parallel, not behind each other or not at even distances.
        FormatError: it is cut off.
    """
    import highdicom
    import pydicom

    kind = pydicom.dcmread(path, stop_before_pixels=True).get("Modality")
    if kind is None:
        raise FormatError("it states no modality; it is cut off, or no image")
    if kind != "SEG":
        raise InputError(
            f"{path}: is a DICOM object of the modality {kind}, and a segmentation (SEG) was expected; give the "
            "segmentation of the series (a folder of the CT itself is given by --ct)"
        )
    segmentation = highdicom.seg.segread(path)
    grid = segmentation.get_volume_geometry(atol=_SHIFTED)
    if grid is None:
        raise InputError(f"{path}: {_no_grid(segmentation)}")
    numbers = [number for number in segmentation.segment_numbers if number]  # 0 is what lies outside all
    if not numbers:
        raise InputError(f"{path}: has no segment; export the segmentation again")
    ends = int(_slices_of_series(segmentation) > grid.spatial_shape[0])
    layers: list[np.ndarray] = []
    names: list[dict[int, str]] = []
    meanings: dict[int, tuple[str, ...]] = {}
    for number in numbers:
        # as the grid above, along (slice, row, column)
        voxels = segmentation.get_volume(segment_numbers=[number], atol=_SHIFTED).array[..., 0]
        inside = np.pad(
            voxels >= _HALF if voxels.dtype.kind == "f" else voxels > 0, [(ends, ends), (0, 0), (0, 0)]
        )
        layer = next((n for n, labels in enumerate(layers) if not labels[inside].any()), len(layers))
        if layer == len(layers):
            layers.append(np.zeros(inside.shape, dtype=np.uint16 if max(numbers) > 255 else np.uint8))
            names.append({})
        layers[layer][inside] = number
        description = segmentation.get_segment_description(number)
        names[layer][number] = str(description.segment_label)
        meanings[number] = _meanings(description)
    notes: list[str] = []
    if ends:
        notes.append(
            "slices without a segment are left out of it, so that a bone cut off by the image is not noticed"
        )
    if segmentation.segmentation_type.value == "FRACTIONAL":
        notes.append("its segments are fractional; a voxel is taken where it holds at least a half")
    voxels = np.stack(layers).transpose(0, 3, 2, 1)  # (layers, column, row, slice)
    affine = grid.affine[:, [2, 1, 0, 3]]
    affine[:, 3] -= ends * affine[:, 2]
    if len(layers) == 1:
        voxels = voxels[0]
    return Stored(lambda part: voxels[..., part], voxels.shape, affine, tuple(names), tuple(notes), meanings)


def _slices_of_series(segmentation: Any) -> int:
    """The slices of the series that was segmented; 0 where the object does not name them."""
    referenced = segmentation.get("ReferencedSeriesSequence") or [{}]
    return len(referenced[0].get("ReferencedInstanceSequence") or ())


def _meanings(description: Any) -> tuple[str, ...]:
    """The meanings of the codes of a segment: its type and its anatomic region, each behind its side."""
    said = []
    for what, of_modifier in (
        ("SegmentedPropertyTypeCodeSequence", "SegmentedPropertyTypeModifierCodeSequence"),
        ("AnatomicRegionSequence", "AnatomicRegionModifierSequence"),
    ):
        for code in description.get(what, ()):
            modifiers = [*description.get(of_modifier, ()), *code.get(of_modifier, ())]
            said.append(" ".join(str(part.CodeMeaning) for part in (*modifiers, code)))
    return tuple(said)


def _no_grid(segmentation: Any) -> str:
    """Why frames are no regular grid, and the cure."""
    shared = segmentation.SharedFunctionalGroupsSequence[0]
    axes, places = [], []
    for frame in segmentation.PerFrameFunctionalGroupsSequence:
        holder = frame if "PlaneOrientationSequence" in frame else shared
        if "PlaneOrientationSequence" not in holder or "PlanePositionSequence" not in frame:
            return "its frames have no place in the patient; export it with the geometry of its series"
        axes.append(np.array(holder.PlaneOrientationSequence[0].ImageOrientationPatient, dtype=float))
        places.append(np.array(frame.PlanePositionSequence[0].ImagePositionPatient, dtype=float))
    if np.ptp(axes, axis=0).max() > _PARALLEL:
        return "its frames lie in different directions; give the segmentation of one series of parallel slices"
    row, column = axes[0][:3], axes[0][3:]
    aside = np.array(places) @ np.stack([row, column], axis=1)
    shift = np.ptp(aside, axis=0).max()
    if shift > _SHIFTED:
        return (
            f"its frames are shifted by up to {shift:.1f} mm against each other, as in a tilted gantry; "
            "resample the series to a straight grid and segment that"
        )
    heights = np.unique(np.round(np.array(places) @ np.cross(row, column), 3))
    if len(heights) < 2:
        return "it has frames at one height only; give the segmentation of the whole series"
    steps = np.diff(heights)
    return (
        f"its frames are {steps.min():.2f} to {steps.max():.2f} mm apart, which are no multiples of one distance; "
        "resample the series to even slices and segment that"
    )
