"""DICOM segmentation objects: the voxels of their segments, names, codes and grids."""

from pathlib import Path

import numpy as np
import pytest

from support.asserting import refuses
from support.dicom_seg import series, write_segmentation
from warp_trunk.io.image_files.image_reader import read_labels
from warp_trunk.preparation.label_maps import read_source

SHAPE = (7, 6, 5)
AFFINE = np.eye(4)
AFFINE[:3, :3] = np.linalg.qr([[0.98, -0.17, 0.10], [0.18, 0.98, -0.05], [-0.09, 0.07, 0.99]])[0] * [0.8, 1.2, 2.5]
AFFINE[:3, 3] = -30.0, 20.0, -400.0
NAMES = {1: "vertebrae_T8", 2: "rib_left_8"}
OVERLAP = np.zeros((2, *SHAPE), dtype=np.uint8)
OVERLAP[0, 1:4, 2:4, 1:3] = 1
OVERLAP[1, 3:6, 3:5, 2:5] = 2  # shares the voxel (3, 3, 2) with the other
APART = np.where(OVERLAP[0] > 0, 1, OVERLAP[1])[None]


def places_of(image, number: int) -> np.ndarray:
    """Sorted points of a label in LPS [mm]."""
    at = np.argwhere((image.layers == number).any(axis=0))
    return sorted_points(at @ image.affine[:3, :3].T + image.affine[:3, 3])


def sorted_points(points: np.ndarray) -> np.ndarray:
    return np.array(sorted(points.round(3).tolist()))


@pytest.mark.parametrize("kind", ["BINARY", "FRACTIONAL", "LABELMAP"])
def test_segments_are_where_they_were_drawn(tmp_path, kind):
    image = read_labels(write_segmentation(tmp_path / "export", APART, AFFINE, NAMES, kind=kind))
    for number in NAMES:
        drawn = np.argwhere(APART[0] == number) @ AFFINE[:3, :3].T + AFFINE[:3, 3]
        np.testing.assert_allclose(places_of(image, number), sorted_points(drawn), atol=2e-3)
    assert [dict(names) for names in image.names] == [NAMES]
    assert any("at least a half" in note for note in image.notes) == (kind == "FRACTIONAL")


def test_segments_that_overlap_keep_all_their_voxels(tmp_path):
    image = read_labels(write_segmentation(tmp_path / "a.dcm", OVERLAP, AFFINE, NAMES))
    assert [dict(names) for names in image.names] == [{1: "vertebrae_T8"}, {2: "rib_left_8"}]
    for number, layer in zip(NAMES, OVERLAP, strict=True):
        drawn = np.argwhere(layer == number) @ AFFINE[:3, :3].T + AFFINE[:3, 3]
        np.testing.assert_allclose(places_of(image, number), sorted_points(drawn), atol=2e-3)


def test_codes_name_bones_whose_labels_do_not(tmp_path):
    codes = {1: ("", "T8 vertebra"), 2: ("Left", "Eighth rib")}
    labels = {1: "Segment_1", 2: "Segment_2"}
    assert read_source(write_segmentation(tmp_path / "a.dcm", APART, AFFINE, labels, codes=codes)).names == {
        "T8",
        "rib_left_08",
    }
    right = {1: ("", "T8 vertebra"), 2: ("Right", "Eighth rib")}
    path = write_segmentation(tmp_path / "b.dcm", APART, AFFINE, labels, codes=right)
    assert "rib_right_08" in read_source(path).names
    numbers = tmp_path / "numbers.csv"
    numbers.write_text("1,vertebrae_T5\n2,rib_left_5\n", encoding="utf-8")
    assert read_source(path, str(numbers)).names == {"T5", "rib_left_05"}  # what the user states holds


def test_a_folder_with_the_object_alone_is_read(tmp_path):
    write_segmentation(tmp_path / "1.2.840", APART, AFFINE, NAMES)
    assert read_source(tmp_path).names == {"T8", "rib_left_08"}
    write_segmentation(tmp_path / "1.2.841", APART, AFFINE, NAMES)
    with refuses("holds 2 DICOM objects", begins=tmp_path):
        read_source(tmp_path)


def tilted(k: int) -> np.ndarray:
    return AFFINE[:3, 3] + k * (AFFINE[:3, 2] + 0.4 * AFFINE[:3, 1])


def uneven(k: int) -> np.ndarray:
    return AFFINE[:3, 3] + (k + 0.4 * (k > 2)) * AFFINE[:3, 2]


@pytest.mark.parametrize(
    ("places", "cause"),
    [
        (tilted, "shifted by up to 1.9 mm against each other, as in a tilted gantry"),
        (uneven, "no multiples"),
    ],
)
def test_frames_that_are_no_grid_are_refused_with_the_cause(tmp_path, places, cause):
    every = np.broadcast_to(np.uint8(1), (1, *SHAPE))
    path = write_segmentation(tmp_path / "a.dcm", every, AFFINE, NAMES, places=places)
    with refuses(cause, begins=path):
        read_labels(path)


def test_frames_that_are_left_out_are_empty(tmp_path):
    labels = np.zeros((1, *SHAPE), dtype=np.uint8)
    labels[0, 2, 2, (0, 1, 4)] = 1, 1, 2  # frames 2 and 3 have no voxel and are not written
    image = read_labels(write_segmentation(tmp_path / "a.dcm", labels, AFFINE, NAMES))
    assert np.count_nonzero(image.layers) == 3
    assert np.ptp(np.argwhere(image.layers[0])[:, 2]) == 4


@pytest.mark.parametrize("first", [0, 1])
def test_a_bone_seems_cut_off_only_where_its_frame_is_the_last_of_the_series(tmp_path, first):
    labels = np.zeros((1, *SHAPE), dtype=np.uint8)
    labels[0, 2, 2, first:] = 1
    labels[0, 4, 4, 4] = 2
    path = write_segmentation(tmp_path / "a.dcm", labels, AFFINE, NAMES)
    assert bool(read_source(path).masks["T8"].faces_at_border()) == (first == 0)
    assert bool(read_labels(path).notes) == (first == 1)


def test_a_slice_of_the_scan_is_no_segmentation(tmp_path: Path):
    header = series(SHAPE, AFFINE)[0]
    header.PixelData = bytes(2 * SHAPE[0] * SHAPE[1])
    header.save_as(tmp_path / "slice.dcm", enforce_file_format=True)
    with refuses("modality CT, and a segmentation", begins=tmp_path / "slice.dcm"):
        read_labels(tmp_path / "slice.dcm")


def test_a_damaged_object_is_refused_by_its_name(tmp_path):
    path = write_segmentation(tmp_path / "a.dcm", APART, AFFINE, NAMES)
    content = path.read_bytes()
    for size in (140, len(content) // 2, len(content) - 3):
        path.write_bytes(content[:size])
        with refuses("cannot be read as a label map", begins=path):
            read_labels(path)
