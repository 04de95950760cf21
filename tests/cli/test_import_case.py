"""The command that makes a case of a label map, on blocks."""

import numpy as np
import pytest
from PIL import Image
from voxelise_case import write_labels

from support.label_maps import LEVELS, NAMES, NUMBERS, labels, write_map
from warp_trunk.case import read_case, read_checked_case, write_case
from warp_trunk.cli import main


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
    rows = (out / "landmarks_confidence.csv").read_text().splitlines()
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
    (tmp_path / "case.toml").write_text("")
    refused(["import", files[0], "--out", tmp_path], "is a case folder")


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
