"""DICOM segmentation objects made by highdicom, as hospitals keep them."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import highdicom
import numpy as np
import pydicom
from highdicom.sr.coding import CodedConcept
from pydicom.dataset import FileMetaDataset
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid

ANATOMY = CodedConcept("91723000", "SCT", "Anatomical structure")


def series(
    shape: tuple[int, ...], affine: np.ndarray, places: Callable[[int], np.ndarray] | None = None
) -> list[Any]:
    """The headers of a CT's slices.

    Args:
        shape: voxels (i, j, k); a slice is (j, i).
        affine: from voxels to LPS [mm], shape (4, 4), at right angles.
        places: where the first voxel of a slice is [mm], where that is not on the grid.
    """
    study, frame, whole = generate_uid(), generate_uid(), generate_uid()
    sides = np.linalg.norm(affine[:3, :3], axis=0)
    axes = affine[:3, :3] / sides
    slices = []
    for k in range(shape[2]):
        place = affine[:3, 3] + k * affine[:3, 2] if places is None else places(k)
        header: Any = pydicom.Dataset()
        header.file_meta = FileMetaDataset()
        header.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
        header.SOPClassUID, header.SOPInstanceUID = CTImageStorage, generate_uid()
        header.StudyInstanceUID, header.SeriesInstanceUID, header.FrameOfReferenceUID = study, whole, frame
        header.Modality, header.SeriesNumber, header.InstanceNumber = "CT", 1, k + 1
        header.PatientID, header.PatientName, header.PatientBirthDate, header.PatientSex = "synthetic", "", "", "O"
        header.StudyID, header.StudyDate, header.StudyTime, header.AccessionNumber = "1", "", "", ""
        header.ReferringPhysicianName = header.PositionReferenceIndicator = ""
        header.ImagePositionPatient = [round(float(x), 6) for x in place]
        header.ImageOrientationPatient = [round(float(x), 9) for x in (*axes[:, 0], *axes[:, 1])]
        header.PixelSpacing = [float(sides[1]), float(sides[0])]  # between rows, between columns
        header.SliceThickness = float(sides[2])
        header.Rows, header.Columns = shape[1], shape[0]
        header.SamplesPerPixel, header.PhotometricInterpretation = 1, "MONOCHROME2"
        header.BitsAllocated, header.BitsStored, header.HighBit, header.PixelRepresentation = 16, 16, 15, 1
        slices.append(header)
    return slices


def write_segmentation(
    path: Path,
    layers: np.ndarray,
    affine: np.ndarray,
    names: Mapping[int, str],
    *,
    codes: Mapping[int, tuple[str, str]] | None = None,
    kind: str = "BINARY",
    places: Callable[[int], np.ndarray] | None = None,
) -> Path:
    """A segmentation object.

    Args:
        path: the file.
        layers: labels, shape (layers, i, j, k); segments of different layers may overlap.
        affine: from voxels to LPS [mm], shape (4, 4).
        names: what the label of each is called.
        codes: the side and the meaning of the code of each; "Bone" without a side when left out.
        kind: BINARY, FRACTIONAL or LABELMAP.
        places: see `series`.
    """
    values = sorted(names)
    masks = np.stack([(layers == value).any(axis=0) for value in values], axis=-1)  # (i, j, k, segments)
    pixels = masks.transpose(2, 1, 0, 3)  # (slice, row, column, segments)
    if kind == "FRACTIONAL":
        pixels = pixels.astype(np.float32)
    elif kind == "LABELMAP":
        pixels = (pixels * np.arange(1, len(values) + 1)).max(axis=-1).astype(np.uint16)
    else:
        pixels = pixels.astype(np.uint8)
    described = []
    for number, value in enumerate(values, 1):
        side, meaning = (codes or {}).get(value, ("", "Bone"))
        description = highdicom.seg.SegmentDescription(
            segment_number=number,
            segment_label=names[value],
            segmented_property_category=ANATOMY,
            segmented_property_type=CodedConcept("272673000", "SCT", meaning),
            algorithm_type="MANUAL",
        )
        if side:
            concept = CodedConcept("24028007" if side == "Right" else "7771000", "SCT", side)
            description.SegmentedPropertyTypeModifierCodeSequence = [concept]
        described.append(description)
    highdicom.seg.Segmentation(
        source_images=series(layers.shape[1:], affine, places),
        pixel_array=pixels,
        segmentation_type=kind,
        segment_descriptions=described,
        series_instance_uid=generate_uid(),
        series_number=2,
        sop_instance_uid=generate_uid(),
        instance_number=1,
        manufacturer="warp_trunk",
        manufacturer_model_name="tests",
        software_versions="1",
        device_serial_number="1",
        transfer_syntax_uid=ExplicitVRLittleEndian,
    ).save_as(path)
    return path
