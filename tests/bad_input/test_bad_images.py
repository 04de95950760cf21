"""Label maps, scans and folders of masks, broken: each ends in one line, and leaves nothing behind."""

import gzip
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pytest
from nibabel.nifti1 import Nifti1Extension
from voxelise_case import write_labels

from support.blocks import blocks
from support.breaking import content
from support.label_maps import NUMBERS, body, labels, write_nrrd
from support.label_maps import write_map as write_label_map
from support.shown import check_shown
from warp_trunk.io.surface_files import write_surface

SEG, BODY = "labels.nii.gz", "body.nii.gz"
TABLE = ["--labels", "totalsegmentator-v2"]
Spoil = Callable[[Path], object]


def image(change: Callable[[Any], Any]) -> Spoil:
    """Another image in the place of the label map, made of it with nibabel."""

    def spoil(folder: Path) -> None:
        old = nibabel.Nifti1Image.from_filename(folder / SEG)
        nibabel.save(change(nibabel.Nifti1Image(np.asarray(old.dataobj), old.affine)), folder / SEG)

    return spoil


def values(change: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    """Other voxels on the same grid."""
    return image(lambda i: nibabel.Nifti1Image(change(np.asarray(i.dataobj)), i.affine))


def raw_header(change: Callable[[Any], object]) -> Spoil:
    """The bytes of the header changed, which nibabel would correct when it writes."""

    def rewritten(data: bytes) -> bytes:
        whole = gzip.decompress(data)
        header = nibabel.Nifti1Header(whole[:348], check=False)
        change(header)
        return gzip.compress(header.binaryblock + whole[348:], 1)

    return content(SEG, rewritten)


def affine(change: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    """Another affine, written as it is."""
    return raw_header(lambda header: header.set_sform(change(header.get_sform()), 1))


def field(name: str, value: Any) -> Spoil:
    return raw_header(lambda header: header.__setitem__(name, value))


def slicer(keys: dict[str, str] | None = None, **fields: str | None) -> Spoil:
    """An .nrrd in place of the NIfTI, with other key/value pairs or fields in its header."""
    segment = {"Segment0_Name": "T8", "Segment0_LabelValue": "36", "Segment0_Layer": "0", **(keys or {})}
    return lambda folder: (
        write_nrrd(folder / "a.seg.nrrd", *labels(), segment, **fields),
        (folder / SEG).unlink(),
    )


def extension(xml: str) -> Spoil:
    def change(i: Any) -> Any:
        i.header.extensions.append(Nifti1Extension(0, xml.encode()))
        return i

    return image(change)


def masks(change: Callable[[Path], object]) -> Spoil:
    """A folder of masks in place of the label map."""

    def spoil(folder: Path) -> None:
        (folder / SEG).unlink()
        (folder / "masks").mkdir()
        own, lps = labels()
        write_labels(folder / "masks" / "vertebrae_T8.nii.gz", (own == 36).astype(np.uint8), lps)
        change(folder / "masks")

    return spoil


NAMED = "<CaretExtension><LabelTable><Label Key='{}'>vertebrae_T8</Label></LabelTable></CaretExtension>"
ROWS: dict[str, tuple[Spoil, list[str]]] = {
    "noise": (content(SEG, lambda b: bytes(range(256)) * 9), []),
    "truncated gzip": (content(SEG, lambda b: b[: len(b) // 2]), []),
    "voxels cut off": (content(SEG, lambda b: gzip.compress(gzip.decompress(b)[:-7])), []),
    "huge dimensions": (field("dim", [3, 30000, 30000, 30000, 1, 1, 1, 1]), []),
    "negative dimensions": (field("dim", [3, -5, 10, 10, 1, 1, 1, 1]), []),
    "4-D": (image(lambda i: nibabel.Nifti1Image(np.stack([i.dataobj] * 2, axis=3), i.affine)), []),
    "one slice": (values(lambda v: v[:, :, 50:51]), []),
    "complex numbers": (image(lambda i: nibabel.Nifti1Image(i.get_fdata().astype(np.complex64), i.affine)), []),
    "probabilities": (values(lambda v: 0.5 * v.astype(np.float32)), []),
    "not finite": (values(lambda v: np.where(v > 0, np.nan, 0.0)), []),
    "a CT instead": (values(lambda v: v.astype(np.int16) - 1000), []),
    "labels with a scale that leaves no whole numbers": (field("scl_slope", 0.3), []),
    "nothing but zeros": (values(np.zeros_like), TABLE),
    "no bone of the trunk": (values(lambda v: np.where(v > 0, NUMBERS["humerus_left"], 0).astype(v.dtype)), TABLE),
    "no names": (values(lambda v: v), []),
    "an affine of zeros": (affine(lambda a: 0.0 * a), []),
    "an affine of one plane": (affine(lambda a: a[:, [0, 0, 2, 3]]), []),
    "metres": (affine(lambda a: a * 1e-3), []),
    "a kilometre away": (affine(lambda a: a + 1e6 * np.eye(4)[:, [3, 3, 3, 0]]), []),
    "no orientation": (field("sform_code", 0), []),
    "names that define entities": (extension("<!DOCTYPE a [<!ENTITY b 'b'>]>" + NAMED.format(36)), []),
    "a name that cannot be printed": (extension(NAMED.format(36).replace("vertebrae", "a&#10;b")), []),
    "two labels of one bone": (
        extension(NAMED.format(36).replace("</LabelTable>", "<Label Key='37'>T8</Label></LabelTable>")), []),
    "a DICOM": (lambda f: ((f / SEG).unlink(), (f / "a.dcm").write_bytes(b"DICM")), []),
    "NRRD in another file": (slicer(data_file="other.raw"), []),
    "NRRD without a space": (slicer(space=None), []),
    "NRRD that states metres": (slicer(space_units='"m" "m" "m"'), []),
    "a segment in no layer": (slicer({"Segment0_Layer": "7"}), []),
    "a folder of no bones": (masks(lambda m: (m / "vertebrae_T8.nii.gz").rename(m / "spleen.nii.gz")), []),
    "a mask and a surface of one bone": (
        masks(lambda m: write_surface(m / "T8.ply", blocks((((0, 0, 0), (4, 4, 4)),)))), []),
    "labels for a folder": (masks(lambda m: None), TABLE),
    "no such table": (lambda f: None, ["--labels", "totalsegmentator-v9"]),
    "a body of nothing": (lambda f: write_labels(f / BODY, 0 * body()[0], body()[1]), []),
    "a body and a CT": (lambda f: None, ["--ct", BODY]),
    "tissue without fat": (lambda f: None, ["--tissue", SEG]),
    "a cut beside the body": (lambda f: None, ["--cut-above", "900"]),
    "an edge of no length": (lambda f: None, ["--edge-length", "0"]),
}  # fmt: skip


@pytest.fixture(scope="module")
def good_map(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A label map and a body; not to be changed."""
    folder = tmp_path_factory.mktemp("good map")
    write_label_map(folder)
    return folder


def test_lines_of_broken_images_are_as_accepted(good_map, refused_row, tmp_path, monkeypatch):
    lines, folder = [], tmp_path / "map"
    for name, (spoil, options) in ROWS.items():
        shutil.copytree(good_map, folder)
        monkeypatch.chdir(folder)
        spoil(Path())
        names = ("masks", "a.seg.nrrd", "a.dcm")
        source = next((place for place in names if Path(place).exists()), SEG)
        lines.append(refused_row(name, ["import", source, "--body", BODY, "--out", tmp_path / "out", *options]))
        assert not (tmp_path / "out").exists()
        monkeypatch.chdir(tmp_path)
        shutil.rmtree(folder)
    check_shown("refused_images", lines)
