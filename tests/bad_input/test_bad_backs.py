"""Scans of a back, spines and markers that are none: one line that names the file, before long work starts."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import warp_trunk.cli.back as back_command
from support.shown import check_shown
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
    return points[::3], spine.line, markers


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


FORWARD, LEFT, UP = np.array([0.0, -400.0, 0.0]), np.array([400.0, 0.0, 0.0]), np.array([0.0, 0.0, 900.0])
BROKEN: dict[str, Callable[..., Any]] = {
    "marker off the scan": marker("PSIS_left", [0.0, 60.0, 0.0]),
    "left and right exchanged": lambda p, s, m: (p, s, Landmarks(("C7", "PSIS_right", "PSIS_left"), m.points)),
    "no C7": marker("C7", None),
    "no pelvis": marker("PSIS_left", None),
    "C7 below the pelvis": marker("C7", [0.0, 0.0, -500.0]),
    "spine outside the body": lambda p, s, m: (p, s + FORWARD, m),
    "spine beside the body": lambda p, s, m: (p, s + LEFT, m),
    "spine above the body": lambda p, s, m: (p, s + UP, m),
    "metres for mm": lambda p, s, m: (p / 1000.0, s, m),
    "a scan of the front": lambda p, s, m: (p + FORWARD, s, Landmarks(m.names, m.points + FORWARD)),
    "few points": lambda p, s, m: (p[:1500], s, m),
    "a spine that runs up": lambda p, s, m: (p, s[::-1], m),
    "a spine in metres": lambda p, s, m: (p, s / 1000.0, m),
    "a spine of two points": lambda p, s, m: (p, s[[0, -1]], m),
    "points that are none": lambda p, s, m: (np.vstack([p, [np.inf] * 3]), s, m),
}  # fmt: skip


def test_lines_of_broken_backs_are_as_accepted(back, refused_row, tmp_path, monkeypatch):
    body, out = made_body(), ["--out", tmp_path / "case"]
    monkeypatch.setattr(back_command, "made_body", lambda: body)
    monkeypatch.chdir(tmp_path)
    lines = [refused_row(name, [*written(*spoil(*back)), *out]) for name, spoil in BROKEN.items()]
    words = written(*back)
    lines.append(refused_row("no atlas", [*words, *out, "--atlas", "none"]))
    parts = [(part, y) for part, y in (("body", 0), ("left_pedicle", 9))]
    rows = [f"T{n}_{part},0,{y},{400 - 25 * n}" for n in range(1, 13) for part, y in parts]
    Path("line.csv").write_text("name,x,y,z\n" + "\n".join(rows) + "\n", encoding="utf-8")
    lines.append(refused_row("a spine without a pedicle", [*words, *out]))
    assert not (tmp_path / "case").exists()
    lines.append(refused_row("a file as output", [*words, "--out", "line.csv"]))
    (tmp_path / "case").mkdir()
    (tmp_path / "case" / "case.toml").touch()
    lines.append(refused_row("a case as output", [*words, *out]))
    check_shown("refused_backs", lines)


def test_an_open_back_is_not_closed_but_led_to_fit_back(refused, tmp_path):
    skin = straight_trunk()[0]
    behind = (skin.vertices[:, 1] > 0.0)[skin.faces].all(axis=1)
    write_surface(tmp_path / "back.ply", type(skin)(skin.vertices, skin.faces[behind]))
    words = ["close", tmp_path / "back.ply", "--out", tmp_path / "skin.ply"]
    refused(words, "% of the closed skin, mostly its front at", "25 % is the most", "warp-trunk fit-back")


def written(points, line, marks) -> list[str]:
    """The words of the command for files with these contents."""
    np.savetxt("back.xyz", points, fmt="%.3f")
    np.savetxt("line.csv", line, delimiter=",", header="x,y,z", comments="")
    write_landmarks("markers.csv", marks)
    return ["fit-back", "back.xyz", "--spine", "line.csv", "--markers", "markers.csv"]
