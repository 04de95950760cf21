"""The commands that make a case of bones, films, a label map and a scan of the back."""

import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from voxelise_case import write_labels

from support.biplanar import biplanar, write_films
from support.blocks import VERTEBRA, blocks, moved, spine_and_hips
from support.label_maps import LEVELS, NAMES, NUMBERS, labels, write_map
from warp_trunk.case import read_case, read_checked_case, write_case
from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.case.landmarks import Landmarks, read_landmarks, write_landmarks
from warp_trunk.cli import main
from warp_trunk.cli.back import fused
from warp_trunk.cli.import_case import _example
from warp_trunk.io.surface_files import read_surface, write_surface
from warp_trunk.preparation.phantom import straight_trunk
from warp_trunk.spine import CobbAngle

BONES = {
    name: bone for name, bone in spine_and_hips().items() if name in ("T5", "T6", "T7", "hip_left", "hip_right")
}


@pytest.fixture
def folder(tmp_path):
    inner = tmp_path / "case" / "bones"
    inner.mkdir(parents=True)
    for name, bone in BONES.items():
        write_surface(inner / f"{name}.ply", bone)
    return tmp_path / "case"


@pytest.mark.parametrize("inside", [".", "bones"])
def test_writes_landmarks_of_a_case_or_a_folder_of_bones(folder, inside, capsys) -> None:
    out = folder / "found.csv"
    assert main(["landmarks", str(folder / inside), "--out", str(out)]) == 0
    landmarks = read_landmarks(out)
    assert landmarks.vertebrae() == ("T5", "T6", "T7")
    assert len(landmarks.names) == 3 * 6 + 2
    said = capsys.readouterr()
    assert "20 landmarks" in said.out
    assert "not found" not in said.err


def test_incomplete_has_a_status_of_its_own_and_names_what_is_missing(folder, capsys) -> None:
    one_pedicle = moved(blocks((*VERTEBRA[:2], *VERTEBRA[3:])), 0.8 * np.eye(3), [0.0, 50.0, 340.0])
    write_surface(folder / "bones" / "T6.ply", one_pedicle)
    out = folder / "found.csv"
    assert main(["landmarks", str(folder), "--out", str(out)]) == 3
    said = [line for line in capsys.readouterr().err.splitlines() if "not found" in line]
    assert len(said) == 1
    assert said[0].startswith("warp-trunk: T6: not found: ")
    assert read_landmarks(out).vertebrae() == ("T5", "T7")


@pytest.mark.parametrize(
    ("picture", "cure"), [("found.svg", "end the name in .png"), ("no/found.png", "there is no folder")]
)
def test_refuses_a_bad_place_of_the_picture_before_any_work(folder, picture, cure, refused) -> None:
    out = folder / "found.csv"
    refused(["landmarks", folder, "--out", out, "--picture", folder / picture], cure)
    assert not out.exists()


def test_triangulate_writes_landmarks_that_a_case_reads(tmp_path, capsys) -> None:
    landmarks = straight_trunk()[2]
    out = tmp_path / "landmarks.csv"
    assert main(["triangulate", *write_films(tmp_path, biplanar(landmarks)), "--out", str(out)]) == 0
    np.testing.assert_allclose(read_landmarks(out).points, landmarks.points, atol=1e-6)
    said = capsys.readouterr().out
    assert f"{len(landmarks.names)} landmarks" in said
    assert "Reprojection error: mean 0.00" in said


def test_triangulate_names_the_landmark_that_is_off_most(tmp_path, capsys) -> None:
    first, second = biplanar(straight_trunk()[2])
    points = first.points.copy()
    points[7] += [0.0, 3.0]  # along the spine, which both films see
    films = write_films(tmp_path, (replace(first, points=points), second))
    assert main(["triangulate", *films, "--out", str(tmp_path / "landmarks.csv")]) == 0
    said = capsys.readouterr().out
    assert re.search(rf"Reprojection error: mean 0\.0\d, largest \d\.\d+ .*\({first.names[7]}\)", said), said


def test_register_writes_the_skin(tmp_path, capsys) -> None:
    skin = straight_trunk()[0]
    rows = np.arange(0, len(skin.vertices), len(skin.vertices) // 20)
    names = tuple(f"marker_{i}" for i in range(len(rows)))
    targets = skin.vertices[rows] + [5.0, -80.0, 2.0]
    write_surface(tmp_path / "scan.ply", skin)
    write_landmarks(tmp_path / "skin.csv", Landmarks(names, skin.vertices[rows]))
    write_landmarks(tmp_path / "films.csv", Landmarks(names, targets))
    flags = ["--skin", "scan.ply", "--on-skin", "skin.csv", "--on-films", "films.csv", "--out", "skin.ply"]
    flags = [flag if flag.startswith("--") else str(tmp_path / flag) for flag in flags]
    assert main(["register", *flags]) == 0
    assert "Rigid part: turns by 0.00 degrees" in capsys.readouterr().out
    moved = read_surface(tmp_path / "skin.ply").vertices
    np.testing.assert_allclose(moved - skin.vertices, np.tile([5.0, -80.0, 2.0], (len(moved), 1)), atol=1e-7)


def test_fit_atlas_writes_every_bone_where_its_landmarks_say(tmp_path, capsys) -> None:
    """A patient who is larger in height than in width, on whom a linear drift puts every vertex exactly."""
    _, bones, marks = straight_trunk()
    (tmp_path / "bones").mkdir()
    for name in ("T7", "T8", "rib_left_08"):
        write_surface(tmp_path / "bones" / f"{name}.ply", bones[name])
    size, place = np.array([1.02, 1.04, 1.1]), np.array([3.0, -7.0, 20.0])
    write_landmarks(tmp_path / "atlas.csv", marks)
    write_landmarks(tmp_path / "patient.csv", Landmarks(marks.names, marks.points * size + place))
    out = tmp_path / "new" / "bones"
    flags = ["--bones", "bones", "--atlas", "atlas.csv", "--patient", "patient.csv", "--out", "new/bones"]
    flags = [flag if flag.startswith("--") else str(tmp_path / flag) for flag in flags]
    assert main(["fit-atlas", *flags]) == 0
    for name in ("T7", "T8", "rib_left_08"):
        written = read_surface(out / f"{name}.ply").vertices
        np.testing.assert_allclose(written, bones[name].vertices * size + place, atol=1e-2)
    head, *rows = (out / "atlas_fit.csv").read_text(encoding="utf-8").splitlines()
    assert head == "name,error,error_left_out"
    assert {row.split(",")[0] for row in rows} <= set(marks.names)
    assert max(float(row.split(",")[1]) for row in rows) < 0.01
    assert str(out) in capsys.readouterr().out


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return write_map(tmp_path_factory.mktemp("map"))


def test_a_case_that_can_be_read_with_its_picture_and_its_confidence(files, tmp_path, capsys):
    out = tmp_path / "case"
    words = ["import", str(files[0]), "--body", str(files[1]), "--out", str(out), "--edge-length", "12"]
    assert main(words) == 0
    case = read_case(out)
    assert (case.name, case.posture) == ("case", "supine")
    assert case.landmarks_before.vertebrae() == LEVELS
    assert case.landmarks_after is None
    rows = (out / "landmarks_confidence.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0] == "vertebra,left_right_differ_mm,off_curve_deg,body_height_mm"
    assert [row.split(",")[0] for row in rows[1:]] == list(LEVELS)
    assert 10.0 < float(rows[1].split(",")[3]) < 20.0  # blocks of 16 mm
    picture = np.asarray(Image.open(out / "landmarks_before.png").convert("RGB"))
    assert (np.abs(picture.astype(int) - [233, 218, 207]).sum(axis=2) < 60).mean() > 0.1  # the skin, shaded
    said = capsys.readouterr()
    assert "6 bones drawn from voxels" in said.out
    assert "scanned supine" in said.err
    with pytest.raises(SystemExit):
        main(["import", "--help"])


@pytest.mark.slow
def test_what_is_missing_is_named_and_the_rest_is_written(files, tmp_path, capsys):
    values, affine = labels()
    write_labels(tmp_path / "a.nii.gz", np.where(values == NUMBERS["hip_left"], 5, values), affine, NAMES)
    out = tmp_path / "case"
    words = ["import", str(tmp_path / "a.nii.gz"), "--body", str(files[1]), "--out", str(out)]
    assert main([*words, "--edge-length", "12"]) == 3
    said = capsys.readouterr()
    assert "asis_left: no landmarks: 'hip_left' is missing" in said.err
    assert "not yet a case that surgery can be planned on" in said.err
    assert "Not taken, as they are no bones of the trunk: label 5" in said.out
    assert (out / "case.toml").is_file()
    assert len(list((out / "bones").iterdir())) == 5


def test_an_imported_case_is_not_written_onto_another(files, tmp_path, refused):
    (tmp_path / "case.toml").write_text("", encoding="utf-8")
    refused(["import", files[0], "--out", tmp_path], "is a case folder")


@pytest.mark.slow
def test_doubts_are_kept_in_the_case_and_shown_by_plan(files, tmp_path, capsys):
    """T6 has no label: import names it, and so does every command that reads the case."""
    values, affine = labels()
    write_labels(tmp_path / "a.nii.gz", np.where(values == NUMBERS["vertebrae_T6"], 0, values), affine, NAMES)
    out = tmp_path / "case"
    main(["import", str(tmp_path / "a.nii.gz"), "--body", str(files[1]), "--out", str(out), "--edge-length", "12"])
    notes = read_case(out).notes
    assert [note for note in notes if note.startswith("T6")]
    assert capsys.readouterr().err.count(notes[0]) == 1
    assert main(["plan", str(out), "--out", str(tmp_path / "b"), "--uiv", "T5", "--liv", "T8", "--curve",
                 "T7,correction=0.5"]) == 2  # fmt: skip
    assert f"warning: {notes[0]}" in capsys.readouterr().err
    write_case(tmp_path / "c", read_case(out))
    assert set(notes) <= set(read_checked_case(tmp_path / "c")[1])


@pytest.mark.parametrize(
    ("curve", "ends"),
    [
        (("T5", "T12", "T8"), ("T4", "L1")),
        (("T11", "L4", "L2"), ("T11", "L4")),
        (("T12", "L4", "L1"), ("T12", "L4")),
    ],
)
def test_a_fusion_holds_the_apex_of_the_curve_that_it_corrects(
    curve: tuple[str, str, str], ends: tuple[str, str]
) -> None:
    assert fused(CobbAngle(30.0, *curve, "left")) == ends


@pytest.mark.parametrize(
    ("levels", "ends"),
    [(VERTEBRAE, ("T4", "T8", "L1")), (VERTEBRAE[12:], ("L1", "L3", "L5")), ((), ("T4", "T8", "L1"))],
)
def test_a_plan_is_proposed_of_the_levels_that_there_are(levels, ends):
    assert _example(levels) == ends
