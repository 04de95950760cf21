"""Motions of bones that cannot be: each row ends in one line, before any long work."""

import pytest

from support.small_case import part_case
from warp_trunk.case import write_case
from warp_trunk.case.motions import Motion

TFM = "#Insight Transform File V1.0\n#Transform 0\nTransform: {}\nParameters: {}\nFixedParameters: 0 0 0\n"
IDENTITY = "1 0 0 0 1 0 0 0 1 "
FILES = {
    "mirrored.txt": "-1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1",
    "other.tfm": TFM.format("BSplineTransform_double_3_3", IDENTITY + "0 0 0"),
    "short.tfm": TFM.format("AffineTransform_double_3_3", IDENTITY),
    "frame.txt": "1 0 0 0\n0 1 0 0\n0 0 1 1500\n0 0 0 1",
}
FRONT = "[front]\n"
ROWS = [
    ("no TOML", "[front\n", "cannot be read as TOML"),
    ("nothing", "", "names no bone"),
    ("unknown bone", "[frnt]\ntranslation = [1, 0, 0]\n", "no bone 'frnt'", "did you mean 'front'?"),
    ("unknown key", FRONT + "translate = [1, 0, 0]\n", "[front]", "translate", "the keys are"),
    ("not finite", FRONT + "translation = [nan, 0, 0]\n", "must be finite"),
    ("no motion", FRONT + "large = true\n", "gives no motion"),
    ("two motions", FRONT + "translation = [1, 0, 0]\nfollows = { core = 0.5 }\n", "follows and translation"),
    ("rotation without a point", FRONT + "rotation = { degrees = 2, axis = [1, 0, 0] }\n", "lacks 'point'"),
    ("too far", FRONT + "translation = [0, 0, -61]\n", "61 mm", "large = true"),
    ("another frame", FRONT + 'transform = "frame.txt"\nlarge = true\n', "outside the skin", "frame"),
    ("no file", FRONT + 'transform = "none.tfm"\n', "none.tfm: there is no such file"),
    ("mirrored", FRONT + 'transform = "mirrored.txt"\n', "mirrored.txt", "mirrors"),
    ("another transform", FRONT + 'transform = "other.tfm"\n', "BSplineTransform_double_3_3"),
    ("nine parameters", FRONT + 'transform = "short.tfm"\n', "12 Parameters"),
    ("follows a stranger", FRONT + "follows = { spine = 1.0 }\n", "no bone 'spine'"),
    ("shares above 1", FRONT + "follows = { core = 0.7, left = 0.7 }\n", "their sum at most 1"),
    ("a circle", FRONT + "follows = { left = 1.0 }\n[left]\nfollows = { front = 1.0 }\n", "follows itself"),
    ("passes through", FRONT + "translation = [0, 35, 0]\n", "'front' passes", "into 'core'"),
]  # fmt: skip


@pytest.fixture(scope="session")
def part_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("part") / "case"
    write_case(folder, part_case(front=Motion(translation=(0.0, -1.0, 0.0))))
    for name, text in FILES.items():
        (folder / name).write_text(text)
    return folder


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_broken_motions_are_refused_in_one_line(part_folder, refused, tmp_path, row):
    _, text, *fragments = row
    (part_folder / "motions.toml").write_text(text)
    refused(["simulate", str(part_folder), "--out", str(tmp_path / "out")], *fragments)
    assert not (tmp_path / "out").exists()


def test_options_that_need_landmarks_are_refused(part_folder, refused, tmp_path):
    (part_folder / "motions.toml").write_text(FRONT + "translation = [0, -1, 0]\n")
    for option in (["--bands"], ["--bones", "spline"], ["--align-pelvis"]):
        refused(["simulate", str(part_folder), "--out", str(tmp_path / "out"), *option], option[0], "leave it out")


def test_the_same_file_name_twice_is_refused(part_folder, refused, tmp_path):
    files = [str(tmp_path / "a.toml"), str(part_folder / "a.toml")]
    words = [word for file in files for word in ("--motions", file)]
    refused(["simulate", str(part_folder), *words], "a name of its own")
