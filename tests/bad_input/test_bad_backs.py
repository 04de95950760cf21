"""Scans of a back, spines and markers that are none: one line that names the file, before long work starts."""

from pathlib import Path

import numpy as np
import pytest

import warp_trunk.cli.back as back_command
from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks, write_landmarks
from warp_trunk.io.surface_files import write_surface
from warp_trunk.preparation.back_scan.body import made_body
from warp_trunk.preparation.back_scan.scan import cut_back
from warp_trunk.preparation.phantom import straight_trunk


@pytest.fixture(scope="module")
def back():
    """Points, spine line and markers of a good scan."""
    skin, bones, marks = straight_trunk()
    points, spine, markers = cut_back(Case(name="a", skin=skin, bones=bones, landmarks_before=marks))
    return points, spine.line, markers


def marker(name, change):
    """Moves one marker, or removes it where there is no change."""

    def spoil(points, line, marks):
        table = dict(zip(marks.names, marks.points.copy(), strict=True))
        if change is None:
            del table[name]
        else:
            table[name] = table[name] + change
        return points, line, Landmarks(tuple(table), np.array(list(table.values())))

    return spoil


def exchanged(points, line, marks):
    return points, line, Landmarks(("C7", "PSIS_right", "PSIS_left"), marks.points)


FORWARD, LEFT, UP = np.array([0.0, -400.0, 0.0]), np.array([400.0, 0.0, 0.0]), np.array([0.0, 0.0, 900.0])
BROKEN = [
    ("marker off the scan", marker("PSIS_left", [0.0, 60.0, 0.0]), "'PSIS_left' is", "mm from the scan, 20 mm is"),
    ("left and right exchanged", exchanged, "PSIS_left must lie left (+x) of PSIS_right", "exchange the names"),
    ("no C7", marker("C7", None), "needs C7, PSIS_left and PSIS_right", "has PSIS_left, PSIS_right"),
    ("no pelvis", marker("PSIS_left", None), "needs C7, PSIS_left", "has C7, PSIS_right"),
    ("C7 below the pelvis", marker("C7", [0.0, 0.0, -500.0]), "C7 must be 150 to 750 mm above L5", "is -"),
    ("spine outside the body", lambda p, s, m: (p, s + FORWARD, m), "lies outside the body", "in front"),
    ("spine beside the body", lambda p, s, m: (p, s + LEFT, m), "mm beside the scan", "one frame"),
    ("spine above the body", lambda p, s, m: (p, s + UP, m), "0 points at the heights", "one frame"),
    ("metres for mm", lambda p, s, m: (p / 1000.0, s, m), "in mm extends over 250 to 2500", "--units m"),
    ("a scan of the front", lambda p, s, m: (p + FORWARD, s, Landmarks(m.names, m.points + FORWARD)),
     "in front of the spine, so it is a scan of the front", "+y to the back"),
    ("few points", lambda p, s, m: (p[:1500], s, m), "needs 2000 points, and there are 1500", "whole scan"),
    ("a spine that runs up", lambda p, s, m: (p, s[::-1], m), "the other way, upwards", "highest point first"),
    ("a spine in metres", lambda p, s, m: (p, s / 1000.0, m), "run down by 100 to 700 mm, and runs 0.", "in mm"),
    ("a spine of two points", lambda p, s, m: (p, s[[0, -1]], m), "a line needs 6 points, and has 2", "more"),
    ("points that are none", lambda p, s, m: (np.vstack([p, [np.inf] * 3]), s, m), "not three finite numbers",
     "remove it"),
]  # fmt: skip


@pytest.fixture(scope="module")
def body():
    """The body of the program, made once."""
    return made_body()


@pytest.mark.parametrize("row", BROKEN, ids=lambda row: row[0])
def test_a_broken_back_is_refused(back, body, refused, tmp_path, monkeypatch, row):
    monkeypatch.setattr(back_command, "made_body", lambda: body)
    _, spoil, *fragments = row
    refused([*written(tmp_path, *spoil(*back)), "--out", str(tmp_path / "case")], *fragments)
    assert not (tmp_path / "case").exists()


def test_a_table_of_a_spine_without_a_pedicle_is_refused(back, refused, tmp_path):
    rows = [
        f"T{n}_{part},0,{y},{400 - 25 * n}" for n in range(1, 13) for part, y in (("body", 0), ("left_pedicle", 9))
    ]
    (tmp_path / "spine.csv").write_text("name,x,y,z\n" + "\n".join(rows) + "\n", encoding="utf-8")
    refused([*written(tmp_path, *back), "--out", str(tmp_path / "case")], "8 or more levels in a row down to L5")


def test_a_missing_atlas_and_a_case_as_output_are_refused(back, refused, tmp_path):
    words = written(tmp_path, *back)
    refused([*words, "--out", str(tmp_path / "case"), "--atlas", str(tmp_path / "none")], "no such folder")
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "case.toml").touch()
    refused([*words, "--out", str(tmp_path / "old")], "is a case folder")


def test_an_open_back_is_not_closed_but_led_to_fit_back(refused, tmp_path):
    skin = straight_trunk()[0]
    behind = (skin.vertices[:, 1] > 0.0)[skin.faces].all(axis=1)
    write_surface(tmp_path / "back.ply", type(skin)(skin.vertices, skin.faces[behind]))
    words = ["close", str(tmp_path / "back.ply"), "--out", str(tmp_path / "skin.ply")]
    refused(words, "% of the closed skin, mostly its front at", "25 % is the most", "warp-trunk fit-back")


def written(folder: Path, points, line, marks) -> list[str]:
    """The words of the command for files with these contents."""
    np.savetxt(folder / "back.xyz", points)
    np.savetxt(folder / "line.csv", line, delimiter=",", header="x,y,z", comments="")
    write_landmarks(folder / "markers.csv", marks)
    spine = folder / "spine.csv" if (folder / "spine.csv").exists() else folder / "line.csv"
    return ["fit-back", str(folder / "back.xyz"), "--spine", str(spine), "--markers", str(folder / "markers.csv")]
