"""The command that finds landmarks, on blocks."""

import numpy as np
import pytest

from support.blocks import VERTEBRA, blocks, moved, spine_and_hips
from warp_trunk.case.landmarks import read_landmarks
from warp_trunk.cli import main
from warp_trunk.io.surface_files import write_surface

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
    found = read_landmarks(out)
    assert found.vertebrae() == ("T5", "T6", "T7")
    assert len(found.names) == 3 * 6 + 2
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
