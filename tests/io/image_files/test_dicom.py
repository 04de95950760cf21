"""A CT as a folder of DICOM files, which SimpleITK writes here slice by slice."""

import locale
from pathlib import Path

import numpy as np
import pytest
import SimpleITK

from support.refusals import refuses
from warp_trunk.io.image_files.image_reader import read_scan

VALUES = np.random.default_rng(0).integers(-1000, 2000, (5, 6, 7)).astype(np.int16)
UPRIGHT = np.array([[0.7, 0.0, 0.0, -30.0], [0.0, 0.8, 0.0, -40.0], [0.0, 0.0, 1.5, 10.0], [0.0, 0.0, 0.0, 1.0]])
TILTED = UPRIGHT + 0.3 * np.eye(4)[:, [1]] * np.eye(4)[2]  # the gantry: slices move to the back as they rise
FEET_FIRST = UPRIGHT @ np.diag([1.0, 1.0, -1.0, 1.0])


def write_series(
    folder: Path, affine: np.ndarray = UPRIGHT, modality: str = "CT", series: str = "1.2.3.1"
) -> Path:
    """VALUES with an intercept, the files named so that files are not in the order of their slices."""
    folder.mkdir(exist_ok=True)
    before = locale.setlocale(locale.LC_CTYPE)
    writer = SimpleITK.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    sides = np.linalg.norm(affine[:3, :2], axis=0)
    axes = affine[:3, :2] / sides
    for k in range(VALUES.shape[2]):
        place = affine[:3] @ [0.0, 0.0, k, 1.0]
        slice_ = SimpleITK.GetImageFromArray(np.ascontiguousarray(VALUES[:, :, k : k + 1].T))
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
    assert image.layers.shape == (1, *VALUES.shape)
    found = {}
    for number, value in np.ndenumerate(image.layers[0]):
        found[tuple((image.affine @ [*number, 1.0]).round(3).tolist())] = value
    for number, value in np.ndenumerate(VALUES):
        assert found[tuple((affine @ [*number, 1.0]).round(3).tolist())] == value


def slice_at(folder: Path, place: int) -> Path:
    return folder / f"1.2.3.1_{3 * place % 7}.dcm"


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-20])


@pytest.mark.parametrize(
    ("spoil", "named"),
    [
        (lambda f: slice_at(f, 3).unlink(), "one is missing"),
        (lambda f: cut(slice_at(f, 3)), "1.2.3.1_2.dcm: is no whole slice"),
        (lambda f: cut(slice_at(f, 6)), "1.2.3.1_4.dcm: is no whole slice"),
        (lambda f: write_series(f, series="1.2.3.2"), "2 are there"),
        (lambda f: [path.unlink() for path in f.iterdir()], "0 are there"),
        (lambda f: write_series(f, modality="MR"), "is no CT but MR"),
        (lambda f: write_series(f, UPRIGHT * [1e-3, 1e-3, 1, 1]), "voxels must be 0.1 to 12 mm long"),
    ],
    ids=["a gap", "a slice cut off", "the last slice cut off", "two series", "nothing", "MR", "in metres"],
)
def test_what_is_no_whole_ct_is_refused(tmp_path: Path, spoil, named: str) -> None:
    folder = write_series(tmp_path / "ct")
    spoil(folder)
    with refuses(str(folder), named):
        read_scan(folder)
