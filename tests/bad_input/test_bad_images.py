"""Label maps, scans and folders of masks, broken: each ends in one line, and leaves nothing behind."""

import gzip
import re
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
from support.label_maps import NAMES, body, labels, write_nrrd
from support.label_maps import write_map as write_label_map
from warp_trunk.io.surface_files import write_surface

SEG, BODY = "labels.nii.gz", "body.nii.gz"
TABLE = ["--labels", "totalsegmentator-v2"]
Spoil = Callable[[Path], object]


def image(change: Callable[[Any], Any]) -> Spoil:
    """Changes the image with NumPy and nibabel, and writes it again."""

    def spoil(folder: Path) -> None:
        values, affine = labels()
        write_labels(folder / SEG, values, affine, NAMES)
        old = nibabel.Nifti1Image.from_filename(folder / SEG)
        loaded = nibabel.Nifti1Image(np.asarray(old.dataobj), old.affine, old.header)
        nibabel.save(change(loaded) or loaded, folder / SEG)

    return spoil


def values(change: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    """Other voxels on the same grid."""
    return image(lambda i: nibabel.Nifti1Image(change(np.asarray(i.dataobj)), i.affine))


def affine(change: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    """Another affine, written as it is."""

    def spoil(i: Any) -> None:
        i.header.set_sform(np.eye(4), 1)
        i.header.set_qform(None, 0)
        i.header["srow_x"], i.header["srow_y"], i.header["srow_z"] = change(i.affine)[:3]
        i.header["sform_code"] = 1

    return raw_header(spoil)


def raw_header(change: Callable[[Any], None]) -> Spoil:
    """The bytes of the header changed, which nibabel would correct when it writes."""

    def spoil(folder: Path) -> None:
        old = nibabel.Nifti1Image.from_filename(folder / SEG)
        whole = gzip.decompress((folder / SEG).read_bytes())
        header = nibabel.Nifti1Header(whole[:348], check=False)
        holder = type("Image", (), {"header": header, "affine": old.affine})
        change(holder)
        (folder / SEG).write_bytes(gzip.compress(header.binaryblock + whole[348:], 1))

    return spoil


def field(name: str, value: Any) -> Spoil:
    def change(i: Any) -> None:
        i.header[name] = value

    return raw_header(change)


def slicer(keys: dict[str, str] | None = None, values: np.ndarray | None = None, **fields: str | None) -> Spoil:
    """An .nrrd in place of the NIfTI, with other key/value pairs or fields in its header."""

    def spoil(folder: Path) -> None:
        own, lps = labels()
        segment = {"Segment0_Name": "T8", "Segment0_LabelValue": "36", "Segment0_Layer": "0"}
        given = own if values is None else values
        write_nrrd(folder / "a.seg.nrrd", given, lps, segment | (keys or {}), **fields)
        (folder / SEG).unlink()

    return spoil


def extension(xml: str) -> Spoil:
    def change(i: Any) -> Any:
        new = nibabel.Nifti1Image(np.asarray(i.dataobj), i.affine)
        new.header.extensions.append(Nifti1Extension(0, xml.encode()))
        return new

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


def gz(path: str, data: bytes) -> Spoil:
    return content(path, lambda _: gzip.compress(data))


NAMED = "<CaretExtension><LabelTable><Label Key='{}'>vertebrae_T8</Label></LabelTable></CaretExtension>"
# fmt: off
ROWS: list[tuple[Any, ...]] = [
    ("no such file", lambda f: (f / SEG).unlink(), "no such file; a label map (.nii, .nii.gz, .nrrd)"),
    ("empty", content(SEG, lambda b: b""), "cannot be read as a label map"),
    ("noise", content(SEG, lambda b: bytes(range(256)) * 9), "cannot be read as a label map", "write it again"),
    ("truncated gzip", content(SEG, lambda b: b[: len(b) // 2]), "cannot be read as a label map"),
    ("gzip without its end", content(SEG, lambda b: b[:-9]), "cannot be read as a label map"),
    ("a byte of gzip changed", content(SEG, lambda b: b[:900] + b"\xff\x00\xff" + b[903:]), "cannot be read"),
    ("gzip of noise", gz(SEG, b"a" * 999), "cannot be read as a label map"),
    ("header only", content(SEG, lambda b: gzip.compress(gzip.decompress(b)[:348])), "cannot be read"),
    ("header and extension only", content(SEG, lambda b: gzip.compress(gzip.decompress(b)[:9000])),
     "cannot be read"),
    ("voxels cut off", content(SEG, lambda b: gzip.compress(gzip.decompress(b)[:-7])), "it is cut off"),
    ("voxels before the header", field("vox_offset", 100.0), "vox offset 100 too low"),
    ("voxels far away", field("vox_offset", 1e15), "cannot be read as a label map"),
    ("huge dimensions", field("dim", [3, 30000, 30000, 30000, 1, 1, 1, 1]), "mm at most; look at its spacing"),
    ("a billion voxels", field("dim", [3, 1000, 1000, 1001, 1, 1, 1, 1]), "cannot be read", "voxels"),
    ("more voxels than the file holds", field("dim", [3, 900, 900, 900, 1, 1, 1, 1]), "it is cut off"),
    ("negative dimensions", field("dim", [3, -5, 10, 10, 1, 1, 1, 1]), "has -5 x 10 x 10 voxels"),
    ("no dimension", field("dim", [0, 1, 1, 1, 1, 1, 1, 1]), "cannot be read as a label map"),
    ("4-D", image(lambda i: nibabel.Nifti1Image(np.stack([i.dataobj] * 2, axis=3), i.affine)), "has 4 dimensions"),
    ("2-D", image(lambda i: nibabel.Nifti1Image(np.asarray(i.dataobj)[:, :, 50], i.affine)), "has 2 dimensions"),
    ("one slice", values(lambda v: v[:, :, 50:51]), "a label map needs 2 along each axis"),
    ("a type that is none", field("datatype", 99), "cannot be read as a label map"),
    ("complex numbers", image(lambda i: nibabel.Nifti1Image(i.get_fdata().astype(np.complex64), i.affine)),
     "type"),
    ("probabilities", values(lambda v: 0.5 * v.astype(np.float32)), "labels are whole numbers",
     "not probabilities"),
    ("not finite", values(lambda v: np.where(v > 0, np.nan, 0.0)), "labels are whole numbers", "nan"),
    ("a CT instead", values(lambda v: v.astype(np.int16) - 1000), "it holds -1000", "that is --ct"),
    ("labels of a million", values(lambda v: v.astype(np.int32) * 100000), "labels are from 0 to 65535"),
    ("labels with a scale", field("scl_slope", 0.5), "labels have no scale"),
    ("nothing but zeros", values(np.zeros_like), *TABLE, "none of its labels is a bone"),
    ("one label everywhere, of no bone", values(lambda v: np.full_like(v, 1)), *TABLE,
     "none of its labels is a bone"),
    ("no names", values(lambda v: v), "its labels have no names",
     "--labels totalsegmentator-v1 or totalsegmentator-v2"),
    ("an affine of zeros", affine(lambda a: 0.0 * a), "voxels must be 0.1 to 12 mm long, these are 0 x 0 x 0 mm"),
    ("an affine that is not finite", affine(lambda a: np.nan * a), "its affine must be finite"),
    ("an affine of one plane", affine(lambda a: a[:, [0, 0, 2, 3]]), "lie nearly in one plane"),
    ("metres", affine(lambda a: a * 1e-3), "0.0015 x 0.0015 x 0.0015 mm, as if they were in m; write"),
    ("micrometres", affine(lambda a: a * 1e3), "1500 x 1500 x 1500 mm, as if they were in micrometres"),
    ("voxels of 20 mm", affine(lambda a: a * 20.0), "voxels must be 0.1 to 12 mm long"),
    ("a kilometre away", affine(lambda a: a + 1e6 * np.eye(4)[:, [3, 3, 3, 0]]), "look at its spacing and origin"),
    ("no orientation", field("sform_code", 0), "neither its sform nor its qform states where"),
    ("names that are no XML", extension("<Label Key='35'>vertebrae_T8</Label"), "cannot be read as a label map"),
    ("names of no number", extension(NAMED.format("many")), "cannot be read as a label map"),
    ("names that define entities", extension("<!DOCTYPE a [<!ENTITY b 'b'>]>" + NAMED.format(36)),
     "define entities"),
    ("a name that cannot be printed", extension(NAMED.format(36).replace("vertebrae", "a&#10;b")),
     "cannot be printed"),
    ("two labels of one bone",
     extension(NAMED.format(36).replace("</LabelTable>", "<Label Key='37'>T8</Label></LabelTable>")),
     "is 'T8', and so is another label"),
    ("a DICOM", lambda f: ((f / SEG).unlink(), (f / "a.dcm").write_bytes(b"DICM")), "'.dcm' is not known"),
    ("NRRD cut off", lambda f: (slicer()(f), content("a.seg.nrrd", lambda b: b[:-400])(f)), "cannot be read"),
    ("NRRD in another file", slicer(data_file="other.raw"), "keeps its voxels in another file"),
    ("NRRD without a space", slicer(space=None), "its space is ''"),
    ("NRRD in an unknown space", slicer(space="scanner-xyz"), "scanner-xyz"),
    ("NRRD without directions", slicer(space_directions=None), "its space directions are ''"),
    ("NRRD by bzip2", slicer(encoding="bzip2"), "bzip2 encoding not available"),
    ("NRRD of blocks", slicer(type="block"), "type is block"),
    ("NRRD that skips bytes", slicer(byte_skip="9"), "expected 3063320 bytes but received"),
    ("NRRD of noise", lambda f: (slicer()(f), content("a.seg.nrrd", lambda b: b"NRRD0004\nnoise")(f)),
     "cannot be read"),
    ("NRRD of two dimensions",
     slicer(values=np.eye(9, dtype="u1"), space=None, space_directions=None, space_origin=None,
            kinds="domain domain"), "has 2 dimensions"),
    ("NRRD in metres", slicer(space_directions="(0.0015,0,0) (0,0.0015,0) (0,0,0.0015)"), "as if they were in m"),
    ("NRRD that states metres", slicer(space_units='"m" "m" "m"'), "its lengths are in m; save it in mm"),
    ("a segment in no layer", slicer({"Segment0_Layer": "7"}), "is said to be in layer 7, there are 1"),
    ("two segments of one label",
     slicer({"Segment1_Name": "T9", "Segment1_LabelValue": "36", "Segment1_Layer": "0"}),
     "have the same label 36"),
    ("a folder of nothing", masks(lambda m: (m / "vertebrae_T8.nii.gz").unlink()), "there is no mask"),
    ("a folder of no bones", masks(lambda m: (m / "vertebrae_T8.nii.gz").rename(m / "spleen.nii.gz")),
     "is a bone that is known"),
    ("a mask and a surface of one bone",
     masks(lambda m: write_surface(m / "T8.ply", blocks((((0, 0, 0), (4, 4, 4)),)))),
     "is 'T8', and so is a surface"),
    ("two masks of one bone",
     masks(lambda m: (m / "T8.nii.gz").write_bytes((m / "vertebrae_T8.nii.gz").read_bytes())),
     "is 'T8', and so is another"),
    ("a damaged mask", masks(lambda m: (m / "vertebrae_T8.nii.gz").write_bytes(b"\x1f\x8b")),
     "T8.nii.gz: cannot be read"),
    ("labels for a folder", masks(lambda m: None), *TABLE, "leave --labels out"),
    ("no such table", lambda f: None, "--labels", "totalsegmentator-v9",
     "--labels: must be totalsegmentator-v1, totalsegm"),
    ("no body", lambda f: (f / BODY).unlink(), "body.nii.gz: there is no such file"),
    ("a body of nothing", lambda f: write_labels(f / BODY, 0 * body()[0], body()[1]),
     "has no voxel that is not 0"),
    ("a body and a CT", lambda f: None, "--ct", BODY, "--ct: the skin is made of --body"),
    ("no tissue", lambda f: None, "--tissue", "none.nii.gz", "none.nii.gz: there is no such file"),
    ("tissue without fat", lambda f: None, "--tissue", SEG, "has no label or mask 'subcutaneous_fat'"),
    ("a cut that is no plane", lambda f: None, "--cut", "1,2,3", "--cut: must be x,y,z,nx,ny,nz"),
    ("a cut beside the body", lambda f: None, "--cut-above", "900", "nothing of the body lies beyond"),
    ("an edge of no length", lambda f: None, "--edge-length", "0", "must be a number from 2 to 20 mm, not 0"),
    ("a posture that is none", lambda f: None, "--posture", "sitting",
     "'sitting' for argument '--posture'", "'supine', 'prone', 'standing'"),
]
# fmt: on


@pytest.fixture(scope="module")
def good_map(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A label map and a body; not to be changed."""
    folder = tmp_path_factory.mktemp("good map")
    write_label_map(folder)
    return folder


def words(row: tuple[str, ...]) -> tuple[list[str], list[str]]:
    """Options with their values, and what must be said."""
    options, said, rest = [], [], list(row)
    while rest:
        word = rest.pop(0)
        if re.fullmatch(r"--[a-z-]+", word):
            options += [word, rest.pop(0)]
        else:
            said.append(word)
    return options, said


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_a_broken_image_is_refused_in_one_line(good_map, refused, tmp_path, monkeypatch, row):
    shutil.copytree(good_map, tmp_path / "map")
    monkeypatch.chdir(tmp_path / "map")
    row[1](Path())
    options, said = words(row[2:])
    given = next(name for name in ("masks", "a.seg.nrrd", "a.dcm", SEG) if Path(name).exists() or name == SEG)
    refused(["import", given, "--body", BODY, "--out", str(tmp_path / "out"), *options], *said)
    assert not (tmp_path / "out").exists()


def test_there_are_sixty_rows():
    assert len({row[0] for row in ROWS}) == len(ROWS) >= 60
