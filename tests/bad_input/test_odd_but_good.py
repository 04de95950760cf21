"""Unusual but valid files are read, and nothing that is read is ever executed."""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from support.audited import audited
from support.breaking import content, text
from support.small_case import small_case
from warp_trunk.case import read_case
from warp_trunk.case.landmarks import read_landmarks
from warp_trunk.io.surface_files import read_surface, write_surface


def as_on_a_mac(folder: Path) -> None:
    for path in (folder, folder / "bones"):
        (path / ".DS_Store").write_bytes(b"\x00")
        (path / "._skin.ply").write_bytes(b"\x00")
    (folder / "bones" / "notes.ply").mkdir()
    (folder / "bones" / "notes.txt").write_text("not a bone", encoding="utf-8")


def in_stl(folder: Path) -> None:
    for name in ("skin", "bones/T7"):
        write_surface(folder / f"{name}.stl", read_surface(folder / f"{name}.ply"))
        (folder / f"{name}.ply").unlink()


def with_a_loose_vertex(folder: Path) -> None:
    skin = read_surface(folder / "skin.ply")
    lines = [f"v {x} {y} {z}" for x, y, z in [(np.nan, 9e9, 0.0), *skin.vertices.tolist()]]
    lines += [f"f {a} {b} {c}" for a, b, c in (skin.faces + 2).tolist()]
    (folder / "skin.obj").write_text("\n".join(lines), encoding="utf-8")
    (folder / "skin.ply").unlink()


def with_measurements(folder: Path) -> None:
    marks = read_landmarks(folder / "landmarks_before.csv")
    rows = zip(marks.names, marks.points.tolist(), strict=True)
    points = [{"label": name, "position": place} for name, place in rows]
    text = json.dumps({"markups": [{"controlPoints": points, "measurements": [{"value": "?"}]}]})
    (folder / "landmarks_before.mrk.json").write_text(text.replace('"?"', "-nan(ind)"), encoding="utf-8")
    (folder / "landmarks_before.csv").unlink()


def linked(folder: Path) -> None:
    (folder / "skin.ply").rename(folder / "scan.bin")
    (folder / "skin.ply").symlink_to("scan.bin")


needs_letters = pytest.mark.skipif(
    sys.getfilesystemencoding() == "ascii", reason="this locale has ASCII file names only; run it in another one"
)
ODD = [
    pytest.param(
        ("spaces and letters of other alphabets",
         lambda f: (f / "bones" / "rib_left_07.ply").rename(f / "bones" / "T7 – Wirbel μ.ply")),
        marks=needs_letters,
    ),
    ("hidden files and folders", as_on_a_mac),
    ("a vertex in no triangle, far away", with_a_loose_vertex),
    ("numbers that are none in the measurements of Slicer", with_measurements),
    ("surfaces of another format", in_stl),
    ("a byte order mark", content("landmarks_after.csv", lambda b: b"\xef\xbb\xbf" + b.replace(b"\n", b"\r\n"))),
    ("a mark before TOML", content("case.toml", lambda b: b"\xef\xbb\xbf" + b)),
    ("nothing in case.toml", content("case.toml", lambda b: b"")),
    ("no case.toml", lambda folder: (folder / "case.toml").unlink()),
    ("a link in the folder", linked),
    ("further columns", text("landmarks_after.csv", lambda t: t.replace("\n", ",5\n").replace("z,5", "z,who"))),
    ("semicolons and decimal commas",
     text("landmarks_after.csv", lambda t: t.replace(",", ";").replace(".", ","))),
    ("tabs", text("landmarks_before.csv", lambda t: t.replace(",", "\t"))),
    ("capital columns", text("landmarks_before.csv", lambda t: t.replace("name,x,y,z", "Name,X,Y,Z"))),
    ("a capital ending", lambda f: (f / "skin.ply").rename(f / "skin.PLY")),
]  # fmt: skip


@pytest.mark.parametrize("row", ODD, ids=lambda row: row[0])
def test_what_is_only_odd_is_read(case, row):
    row[1](case)
    read = read_case(case)
    assert (len(read.bones), len(read.skin.vertices)) == (7, len(small_case().skin.vertices))


@needs_letters
def test_folders_may_be_named_in_any_way_and_be_links(good_case, tmp_path):
    folder = tmp_path / "Fälle 2026" / "#1 %20 (a)"
    shutil.copytree(good_case, folder)
    (tmp_path / "by another name").symlink_to(folder)
    assert len(read_case(tmp_path / "by another name").bones) == 7


def test_a_case_opens_its_own_files_and_no_other(good_case):
    read_case(good_case)  # what is loaded once
    with audited() as events:
        read_case(good_case)
    assert {event for event, _ in events} == {"open"}
    ours = {str(path) for path in good_case.rglob("*")}
    assert {path for _, path in events} <= ours
