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
# fmt: off
ROWS: list[tuple[Any, ...]] = [
    ("noise", content(SEG, lambda b: bytes(range(256)) * 9), "cannot be read as a label map", "write it again"),
    ("truncated gzip", content(SEG, lambda b: b[: len(b) // 2]), "cannot be read as a label map"),
    ("voxels cut off", content(SEG, lambda b: gzip.compress(gzip.decompress(b)[:-7])), "it is cut off"),
    ("huge dimensions", field("dim", [3, 30000, 30000, 30000, 1, 1, 1, 1]), "mm at most; look at its spacing"),
    ("negative dimensions", field("dim", [3, -5, 10, 10, 1, 1, 1, 1]), "has -5 x 10 x 10 voxels"),
    ("4-D", image(lambda i: nibabel.Nifti1Image(np.stack([i.dataobj] * 2, axis=3), i.affine)), "has 4 dimensions"),
    ("one slice", values(lambda v: v[:, :, 50:51]), "a label map needs 2 along each axis"),
    ("complex numbers", image(lambda i: nibabel.Nifti1Image(i.get_fdata().astype(np.complex64), i.affine)),
     "type"),
    ("probabilities", values(lambda v: 0.5 * v.astype(np.float32)), "labels are whole numbers",
     "not probabilities"),
    ("not finite", values(lambda v: np.where(v > 0, np.nan, 0.0)), "labels are whole numbers", "nan"),
    ("a CT instead", values(lambda v: v.astype(np.int16) - 1000), "it holds -1000", "that is --ct"),
    ("labels with a scale that leaves no whole numbers", field("scl_slope", 0.3), "labels are whole numbers"),
    ("nothing but zeros", values(np.zeros_like), TABLE, "none of its labels is a bone"),
    ("no bone of the trunk", values(lambda v: np.where(v > 0, NUMBERS["humerus_left"], 0).astype(v.dtype)), TABLE,
     "no bone of the trunk among the labels (humerus_left)"),
    ("no names", values(lambda v: v), "its labels have no names",
     "--labels totalsegmentator-v1 or totalsegmentator-v2"),
    ("an affine of zeros", affine(lambda a: 0.0 * a), "voxels must be 0.1 to 12 mm long, these are 0 x 0 x 0 mm"),
    ("an affine of one plane", affine(lambda a: a[:, [0, 0, 2, 3]]), "lie nearly in one plane"),
    ("metres", affine(lambda a: a * 1e-3), "0.0015 x 0.0015 x 0.0015 mm; write the file with its spacing in mm"),
    ("a kilometre away", affine(lambda a: a + 1e6 * np.eye(4)[:, [3, 3, 3, 0]]), "look at its spacing and origin"),
    ("no orientation", field("sform_code", 0), "neither its sform nor its qform states where"),
    ("names that define entities", extension("<!DOCTYPE a [<!ENTITY b 'b'>]>" + NAMED.format(36)),
     "define entities"),
    ("a name that cannot be printed", extension(NAMED.format(36).replace("vertebrae", "a&#10;b")),
     "cannot be printed"),
    ("two labels of one bone",
     extension(NAMED.format(36).replace("</LabelTable>", "<Label Key='37'>T8</Label></LabelTable>")),
     "is 'T8', and so is another label"),
    ("a DICOM", lambda f: ((f / SEG).unlink(), (f / "a.dcm").write_bytes(b"DICM")), "'.dcm' is not known"),
    ("NRRD in another file", slicer(data_file="other.raw"), "keeps its voxels in another file"),
    ("NRRD without a space", slicer(space=None), "its space is ''"),
    ("NRRD that states metres", slicer(space_units='"m" "m" "m"'), "its lengths are in m; save it in mm"),
    ("a segment in no layer", slicer({"Segment0_Layer": "7"}), "is said to be in layer 7, there are 1"),
    ("a folder of no bones", masks(lambda m: (m / "vertebrae_T8.nii.gz").rename(m / "spleen.nii.gz")),
     "is a bone that is known"),
    ("a mask and a surface of one bone",
     masks(lambda m: write_surface(m / "T8.ply", blocks((((0, 0, 0), (4, 4, 4)),)))),
     "is 'T8', and so is a surface"),
    ("labels for a folder", masks(lambda m: None), TABLE, "leave --labels out"),
    ("no such table", lambda f: None, ["--labels", "totalsegmentator-v9"],
     "--labels: must be totalsegmentator-v1, totalsegm"),
    ("a body of nothing", lambda f: write_labels(f / BODY, 0 * body()[0], body()[1]),
     "has no voxel that is not 0"),
    ("a body and a CT", lambda f: None, ["--ct", BODY], "--ct: the skin is made of --body"),
    ("tissue without fat", lambda f: None, ["--tissue", SEG], "has no label or mask 'subcutaneous_fat'"),
    ("a cut beside the body", lambda f: None, ["--cut-above", "900"], "nothing of the body lies beyond"),
    ("an edge of no length", lambda f: None, ["--edge-length", "0"], "must be a number from 2 to 20 mm, not 0"),
    ("a posture that is none", lambda f: None, ["--posture", "sitting"],
     "'sitting' for argument '--posture'", "'standing', 'supine', 'prone'"),
]
# fmt: on


@pytest.fixture(scope="module")
def good_map(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A label map and a body; not to be changed."""
    folder = tmp_path_factory.mktemp("good map")
    write_label_map(folder)
    return folder


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_a_broken_image_is_refused_in_one_line(good_map, refused, tmp_path, monkeypatch, row):
    shutil.copytree(good_map, tmp_path / "map")
    monkeypatch.chdir(tmp_path / "map")
    row[1](Path())
    options, *said = row[2:] if isinstance(row[2], list) else ([], *row[2:])
    source = next(name for name in ("masks", "a.seg.nrrd", "a.dcm", SEG) if Path(name).exists() or name == SEG)
    refused(["import", source, "--body", BODY, "--out", str(tmp_path / "out"), *options], *said)
    assert not (tmp_path / "out").exists()
