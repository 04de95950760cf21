"""NIfTI and NRRD files and folders of DICOM, whichever way their axes run."""

import locale
from collections.abc import Callable
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pytest
import SimpleITK

from support.asserting import refuses
from support.label_maps import write_nrrd
from support.refusals import refusal
from support.shown import check_shown
from warp_trunk.io.image_files.image_reader import read_labels, read_scan

VALUES = np.zeros((4, 5, 6), dtype=np.uint8)
VALUES[1, 2, 3], VALUES[3, 4, 5] = 7, 200
RAS = np.array([[2.0, 0.1, 0.0, -10.0], [-0.1, 2.0, 0.0, 20.0], [0.0, 0.0, 3.0, 30.0], [0.0, 0.0, 0.0, 1.0]])


def nifti(path: Path, values: Any = VALUES, affine=RAS, change=lambda image: None, kind=nibabel.Nifti1Image):
    image = kind(values, affine)
    change(image)
    nibabel.save(image, path)
    return path


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz", "A.NII.GZ"])
@pytest.mark.parametrize("kind", [nibabel.Nifti1Image, nibabel.Nifti2Image])
@pytest.mark.parametrize("dtype", ["u1", "i2", "u2", "i4", "f4", "f8", ">i2", ">f4"])
def test_labels_are_read_as_whole_numbers_in_lps(tmp_path, name, kind, dtype):
    content = nifti(tmp_path / name.lower(), VALUES.astype(dtype), kind=kind).read_bytes()
    (tmp_path / name).write_bytes(content)
    image = read_labels(tmp_path / name)
    assert image.layers.dtype == np.uint8
    np.testing.assert_array_equal(image.layers, VALUES[None])
    np.testing.assert_allclose(image.affine, np.diag([-1, -1, 1, 1]) @ RAS, atol=1e-5)


def test_large_labels_widen_the_type_wherever_they_come(tmp_path):
    values = np.zeros((300, 300, 200), dtype=np.uint16)
    values[1, 1, 1], values[2, 2, 199] = 5, 40000
    image = read_labels(nifti(tmp_path / "a.nii.gz", values))
    assert image.layers.dtype == np.uint16
    np.testing.assert_array_equal(image.layers[0], values)


def test_units_of_the_header_become_millimetres(tmp_path):
    in_metres = np.diag([1e-3, 1e-3, 1e-3, 1.0]) @ RAS
    path = nifti(tmp_path / "a.nii", affine=in_metres, change=lambda i: i.header.set_xyzt_units("meter"))
    np.testing.assert_allclose(read_labels(path).affine, np.diag([-1, -1, 1, 1]) @ RAS, rtol=1e-5)


def test_a_ct_is_read_in_hounsfield_units(tmp_path):
    values = np.linspace(-1000, 2000, VALUES.size).reshape(VALUES.shape)

    def scaled(image):
        image.header.set_data_dtype(np.int16)
        image.header.set_slope_inter(0.5, -24.0)

    path = nifti(tmp_path / "ct.nii.gz", values, change=scaled)
    image = read_scan(path)
    assert image.layers.dtype == np.int16
    assert np.abs(image.layers[0] - nibabel.Nifti1Image.from_filename(path).get_fdata()).max() <= 0.5


@pytest.mark.parametrize("encoding", ["raw", "gzip"])
@pytest.mark.parametrize(
    ("space", "signs"),
    [("left-posterior-superior", (1, 1)), ("RAS", (-1, -1)), ("right-anterior-superior", (-1, -1)),
     ("left-anterior-superior", (1, -1))],
)  # fmt: skip
def test_an_nrrd_says_itself_where_left_is(tmp_path, encoding, space, signs):
    write_nrrd(tmp_path / "a.nrrd", VALUES, RAS, space=space, encoding=encoding)
    image = read_labels(tmp_path / "a.nrrd")
    np.testing.assert_array_equal(image.layers[0], VALUES)
    np.testing.assert_allclose(image.affine, np.diag([*signs, 1, 1]) @ RAS)


def test_segments_of_slicer_lie_in_layers(tmp_path):
    layers = np.stack([VALUES == 7, 3 * (VALUES == 200)]).astype(np.uint8)
    keys = {"Segment0_Name": "T8", "Segment0_LabelValue": "1", "Segment0_Layer": "0"}
    keys |= {"Segment1_Name": "left rib 8", "Segment1_LabelValue": "3", "Segment1_Layer": "1"}
    image = read_labels(write_nrrd(tmp_path / "a.seg.nrrd", layers, RAS, keys))
    assert image.names == ({1: "T8"}, {3: "left rib 8"})
    np.testing.assert_array_equal(image.layers, layers)
    np.testing.assert_allclose(image.affine[:3], RAS[:3])


@pytest.mark.parametrize(
    ("signs", "said"),
    [
        ([1, 1, 1], None), ([-1, 1, 1], "left and right differ"), ([1, -1, 1], "front and back differ"),
        ([-1, -1, 1], "left and right and front and back differ"), ([1, 1, -1], "head and feet differ"),
    ],
)  # fmt: skip
def test_an_sform_that_is_not_the_qform_is_named_by_the_side(signs, said, tmp_path):
    path = nifti(tmp_path / "a.nii")
    image: Any = nibabel.load(path)
    image.set_sform(np.diag([2.0, 2.0, 3.0, 1.0]), code=1)
    image.set_qform(np.diag([*np.multiply(signs, [2.0, 2.0, 3.0]), 1.0]), code=1)
    nibabel.save(image, tmp_path / "b.nii")
    read = read_labels(tmp_path / "b.nii")
    assert (read.notes == ()) == (said is None)
    assert said is None or f"{said}; the sform is used" in read.notes[0]
    np.testing.assert_allclose(read.affine, np.diag([-2.0, -2.0, 3.0, 1.0]), atol=1e-5)


SLICES = np.random.default_rng(0).integers(-1000, 2000, (5, 6, 7)).astype(np.int16)
UPRIGHT = np.array([[0.7, 0.0, 0.0, -30.0], [0.0, 0.8, 0.0, -40.0], [0.0, 0.0, 1.5, 10.0], [0.0, 0.0, 0.0, 1.0]])
TILTED = UPRIGHT + 0.3 * np.eye(4)[:, [1]] * np.eye(4)[2]  # the gantry: slices move to the back as they rise
FEET_FIRST = UPRIGHT @ np.diag([1.0, 1.0, -1.0, 1.0])


def write_series(
    folder: Path,
    affine: np.ndarray = UPRIGHT,
    modality: str = "CT",
    series: str = "1.2.3.1",
    shift: Callable[[int], tuple[float, ...]] = lambda k: (0.0, 0.0, 0.0),
) -> Path:
    """SLICES with an intercept, the files named so that files are not in the order of their slices."""
    folder.mkdir(exist_ok=True)
    before = locale.setlocale(locale.LC_CTYPE)
    writer = SimpleITK.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    sides = np.linalg.norm(affine[:3, :2], axis=0)
    axes = affine[:3, :2] / sides
    for k in range(SLICES.shape[2]):
        place = affine[:3] @ [0.0, 0.0, k, 1.0] + shift(k)
        slice_ = SimpleITK.GetImageFromArray(np.ascontiguousarray(SLICES[:, :, k : k + 1].T))
        slice_.SetSpacing([*sides.tolist(), 1.5])
        fields = {
            "0008|0016": "1.2.840.10008.5.1.4.1.1.2", "0008|0018": f"{series}.{k + 1}", "0008|0060": modality,
            "0020|000d": "1.2.3", "0020|000e": series, "0020|0013": str(k + 1),
            "0020|0032": "\\".join(f"{x:.6g}" for x in place),
            "0020|0037": "\\".join(f"{x:.6g}" for x in axes.T.reshape(-1)),
            "0028|1052": "-1024", "0028|1053": "1",
        }  # fmt: skip
        for name, value in fields.items():
            slice_.SetMetaData(name, value)
        writer.SetFileName(str(folder / f"{series}_{3 * k % 7}.dcm"))
        writer.Execute(slice_)
    locale.setlocale(locale.LC_CTYPE, before)  # the writer leaves that of C, with which other tests read no UTF-8
    return folder


@pytest.mark.parametrize("affine", [UPRIGHT, TILTED, FEET_FIRST], ids=["upright", "tilted gantry", "feet first"])
def test_every_voxel_lies_where_its_slice_says(tmp_path: Path, affine: np.ndarray) -> None:
    image = read_scan(write_series(tmp_path / "ct", affine))
    assert image.layers.shape == (1, *SLICES.shape)
    voxels = {}
    for number, value in np.ndenumerate(image.layers[0]):
        voxels[tuple((image.affine @ [*number, 1.0]).round(3).tolist())] = value
    for number, value in np.ndenumerate(SLICES):
        assert voxels[tuple((affine @ [*number, 1.0]).round(3).tolist())] == value


def slice_at(folder: Path, place: int) -> Path:
    return folder / f"1.2.3.1_{3 * place % 7}.dcm"


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-20])


SPOILED = {
    "a gap": lambda f: slice_at(f, 3).unlink(),
    "a gantry that tilts": lambda f: write_series(f, shift=lambda k: (0, 0.1 * k * k, 0)),
    "doubled slices": lambda f: write_series(f, shift=lambda k: (0, 0, -1.5 if k == 4 else 0)),
    "uneven steps": lambda f: write_series(f, shift=lambda k: (0, 0, 0.4 * (k > 3))),
    "a slice cut off": lambda f: cut(slice_at(f, 3)),
    "the last slice cut off": lambda f: cut(slice_at(f, 6)),
    "two series": lambda f: write_series(f, series="1.2.3.2"),
    "nothing": lambda f: [path.unlink() for path in f.iterdir()],
    "MR": lambda f: write_series(f, modality="MR"),
    "in metres": lambda f: write_series(f, UPRIGHT * [1e-3, 1e-3, 1, 1]),
}


def test_lines_of_what_is_no_whole_ct_are_as_accepted(tmp_path: Path) -> None:
    lines = []
    for name, spoil in SPOILED.items():
        folder = write_series(tmp_path / name)
        spoil(folder)
        lines.append(refusal(name, tmp_path, lambda folder=folder: read_scan(folder)))
    check_shown("refused_scans", lines)


def test_labels_that_headers_round_scale_or_pad_are_whole_numbers(tmp_path: Path) -> None:
    whole = np.zeros((4, 5, 6), dtype=np.float32)
    whole[1:3, 1:4, 1:5] = 112.0

    path = tmp_path / "a.nii"
    for values, slope in (
        (np.where(whole > 0, 111.9996, -1.0).astype(np.float32), 1.0),
        ((whole / 2.0).astype(np.int16), 2.0),
    ):
        nibabel.save(nibabel.Nifti1Image(values, np.diag([2.0, 2.0, 2.0, 1.0])), path)
        raw = bytearray(path.read_bytes())
        raw[112:116] = np.float32(slope).tobytes()  # scl_slope
        path.write_bytes(raw)
        np.testing.assert_array_equal(read_labels(path).layers[0], whole.astype(np.uint8))


@pytest.mark.parametrize("length", [1.0 + 4e-7, 1.2])
def test_a_rounded_quaternion_is_read_and_a_wrong_one_gives_way_to_the_sform(length, tmp_path: Path) -> None:
    image = nibabel.Nifti1Image(np.ones((4, 5, 6), dtype=np.uint8), np.diag([-2.0, -2.0, 3.0, 1.0]))
    image.set_qform(np.diag([-2.0, -2.0, 3.0, 1.0]), code=1)
    nibabel.save(image, tmp_path / "a.nii")
    raw = bytearray((tmp_path / "a.nii").read_bytes())
    raw[256:268] = np.array([0.0, 0.0, length], dtype=np.float32).tobytes()  # half a turn about z
    (tmp_path / "a.nii").write_bytes(raw)
    np.testing.assert_allclose(read_labels(tmp_path / "a.nii").affine, np.diag([2.0, 2.0, 3.0, 1.0]), atol=1e-3)
    raw[254:256] = np.int16(0).tobytes()  # sform_code
    (tmp_path / "a.nii").write_bytes(raw)
    if length > 1.1:
        with refuses("its quaternion is no rotation"):
            read_labels(tmp_path / "a.nii")
    else:
        read_labels(tmp_path / "a.nii")


def test_segments_are_read_beyond_a_gap_in_their_numbers(tmp_path: Path) -> None:
    layers = np.zeros((1, 4, 5, 6), dtype=np.uint8)
    layers[0, 1], layers[0, 2] = 1, 2
    names = {"Segment0_Name": "T8", "Segment0_LabelValue": "1", "Segment7_Name": "T9", "Segment7_LabelValue": "2"}
    write_nrrd(tmp_path / "a.seg.nrrd", layers[0], np.diag([2.0, 2.0, 2.0, 1.0]), names)
    assert read_labels(tmp_path / "a.seg.nrrd").names == ({1: "T8", 2: "T9"},)
