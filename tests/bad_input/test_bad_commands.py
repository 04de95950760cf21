"""Arguments, results, films, scans and meshes that are not what a command needs: one line, nothing left behind."""

import json
import os
import shutil
import sys
from pathlib import Path

import pytest

from support.asserting import forbid_meshing
from support.biplanar import biplanar, write_films
from support.breaking import content, ply
from support.report_results import write_small_result
from support.small_case import small_case
from warp_trunk.case.landmarks import Landmarks, write_landmarks
from warp_trunk.cli import main
from warp_trunk.cli.output import FILE_ERROR
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import write_surface


@pytest.fixture(scope="module")
def good_result(tmp_path_factory):
    """A result folder; not to be changed."""
    return write_small_result(tmp_path_factory.mktemp("good result"))


def summary(change):
    """Changes the summary of a result."""

    def spoil(folder: Path) -> None:
        said = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        change(said)
        (folder / "summary.json").write_text(json.dumps(said), encoding="utf-8")

    return spoil


RESULTS = [
    ("report", "no summary", lambda f: (f / "summary.json").unlink(), "summary.json: there is no such file"),
    ("report", "a deep summary", lambda f: (f / "summary.json").write_bytes(b'{"parameters": ' + b"[" * 10**5),
     "was changed by hand"),
    ("report", "of another version", summary(lambda s: s.pop("tissues")), "another version",
     "missing required field `tissues`"),
    ("report", "unknown status", summary(lambda s: s.update(status="FINE")), "enum value 'FINE'", "`$.status`"),
    ("report", "no increment", summary(lambda s: s.update(increments=[])), "length >= 1 - at `$.increments`"),
    ("report", "no skin", lambda f: (f / "predicted_skin.ply").unlink(), "predicted_skin.ply: is missing"),
    ("report", "skin cut off", lambda f: (f / "predicted_skin.ply").write_bytes(ply(10**9, 1)),
     "predicted_skin.ply: cannot be read"),
    ("report", "other landmarks", lambda f: (f / "landmarks_after.csv").write_bytes(b"name,x,y,z\na,1,2,3\n"),
     "its names must be"),
    ("export", "no mesh", lambda f: (f / "trunk.vtu").unlink(), "trunk.vtu: there is no such file"),
    ("export", "mesh cut off", content("trunk.vtu", lambda b: b[:3000]), "trunk.vtu: cannot be read as a mesh"),
    ("export", "entities", content("trunk.vtu", lambda b: b'<!DOCTYPE a [<!ENTITY b "b">]>' + b), "entities"),
    ("export", "another program's", content("trunk.vtu", lambda b: b.replace(b"skin_vertex", b"something__")),
     "as a trunk mesh (it has no point data 'skin_vertex')"),
]  # fmt: skip


@pytest.mark.parametrize("row", RESULTS, ids=lambda row: row[1])
def test_a_broken_result_is_neither_reported_nor_exported(good_result, refused, tmp_path, row):
    command, _, spoil, *fragments = row
    folder = Path(shutil.copytree(good_result, tmp_path / "result"))
    spoil(folder)
    refused([command, str(folder), "--out", str(tmp_path / "out.inp")], *fragments)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["result"]


INCLUDES = [
    ("a.inp", "*HEADING\n*Include, input=secret.inp\n", "*INCLUDE, and other files are not opened"),
    ("a.xdmf", '<Xdmf><DataItem Format="HDF">secret.h5:/a</DataItem></Xdmf>', "data in other files"),
    ("a.msh", "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 1000000000000 1 1\n", "cannot be read as a mesh"),
]


@pytest.mark.parametrize("row", INCLUDES, ids=lambda row: row[0])
def test_a_mesh_that_opens_others_or_fills_the_memory_is_refused(good_case, refused, tmp_path, row):
    name, text, fragment = row
    (tmp_path / name).write_text(text, encoding="utf-8")
    (tmp_path / "secret.inp").write_text("*NODE\n1, 0, 0, 0\n", encoding="utf-8")
    out = ["--out", str(tmp_path / "out")]
    refused(["simulate", str(good_case), "--from-mesh", str(tmp_path / name), *out], name, fragment)


def completed(flags: list[str], needed: list[str]) -> list[str]:
    """The flags and those that a command needs, each with its value, where they do not give them."""
    missing = [
        [option, value] for option, value in zip(needed[::2], needed[1::2], strict=True) if option not in flags
    ]
    return [*flags, *(word for pair in missing for word in pair)]


def test_a_result_goes_only_where_it_can_be_written(good_case, refused, tmp_path):
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    refused(["simulate", str(good_case), "--out", str(tmp_path / "file")], "a result cannot be written here")
    refused(["simulate", str(good_case), "--out", str(tmp_path / "file" / "sub")], "cannot be written here")
    if sys.platform != "win32" and os.geteuid():  # for root every folder is its own
        (tmp_path / "locked").mkdir(mode=0o500)
        refused(["simulate", str(good_case), "--out", str(tmp_path / "locked")], "Permission denied")


def test_a_full_disk_is_told_before_any_work(good_case, refused, tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr("shutil.disk_usage", lambda path: usage._replace(free=10**6))
    refused(["simulate", str(good_case), "--out", str(tmp_path / "out")], "1 MB are free on this disk")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_disk_that_fills_up_ends_in_one_line_and_leaves_no_half(case, tmp_path, monkeypatch, capsys):
    def full(self, data):
        with open("/dev/full", "wb", buffering=0) as file:
            file.write(data)

    on_skin = small_case().skin.vertices[::400]
    write_landmarks(tmp_path / "markers.csv", Landmarks(tuple("abcdefghi"[: len(on_skin)]), on_skin))
    markers = ["--on-skin", str(tmp_path / "markers.csv"), "--on-films", str(tmp_path / "markers.csv")]
    monkeypatch.setattr(Path, "write_bytes", full)
    before = sorted(tmp_path.iterdir())
    arguments = ["register", "--skin", str(case / "skin.ply"), *markers, "--out", str(tmp_path / "out.ply")]
    assert main(arguments) == FILE_ERROR
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(
        f"warp-trunk: {tmp_path / 'out.ply'}: No space left on device; free some space there, or"
    )
    assert sorted(tmp_path.iterdir()) == before


METRES = "landmarks in metres"
PATIENT = ["--patient", "case/landmarks_after.csv"]
REFUSED_OPTIONS = [
    ("simulate", "no increment", ["case", "--increments", "0"], "must be a number from 1 to 10000, not 0"),
    ("simulate", "too many tetrahedra", ["case", "--tets", "100000000000"], "a number from 4 to 5e+07"),
    ("simulate", "too few for the skin", ["case", "--tets", "100", "--no-cache"], "were asked for", "; ask for"),
    ("simulate", "tolerance NaN", ["case", "--tolerance", "nan"], "must be a finite number of at least 0 mm"),
    ("simulate", "gravity upwards", ["case", "--gravity", "-9.81"], "must be a number from 0 to 1000"),
    ("simulate", "negative threads", ["case", "--threads", "-1", "--no-cache"], "must be a number from 0 to 1024"),
    ("simulate", "no such mesh", ["case", "--from-mesh", "nowhere.vtu"], "there is no such file"),
    ("simulate", "a mesh of another format", ["case", "--from-mesh", __file__], "'.py' is not read as a mesh"),
    ("simulate", "layers without labels", ["case", "--layers", "mesh"], "mesh"),
    ("view", "a surface", ["case/skin.ply"], "skin.ply: is no recording"),
    ("measure", "TOML", ["case/case.toml", "--case", "case"], "'.toml' is not known"),
    ("measure", "metres", ["metres.ply", "--case", "case"], "metres.ply: must lie where the skin of the case is"),
    ("make-case", "Cobb 1000", ["--skin", "case/skin.ply", "--cobb", "1000"], "0 to 120 degrees, not 1000"),
    ("make-case", "correction 70", ["--skin", "case/skin.ply", "--correction", "70"], "for 70 % write 0.7"),
    ("make-case", "no vertebra", ["--skin", "case/skin.ply"], "no landmarks on 'T7': no canal between"),
    ("close", "the same file twice", ["case/skin.ply", "case/skin.ply"], "a file is given twice"),
    ("close", "no transform", ["case/skin.ply", "--transforms", "none.txt"], "none.txt: there is no such file"),
    ("close", "a transform that is a surface", ["case/skin.ply", "--transforms", "case/skin.ply"], "skin.ply"),
    ("close", "no such folder", ["case/skin.ply", "--out", "no/such/skin.ply"], "there is no folder"),
    ("fit-atlas", "nugget inf", [*PATIENT, "--nugget", "inf"], "'nugget' must be 0 to"),
    ("fit-atlas", METRES, ["--patient", "metres.csv"], "a ratio of 2.5 is the most; give both in mm"),
    ("fit-atlas", "a file", [*PATIENT, "--out", "metres.csv"], "metres.csv: is a file"),
    ("register", "a skin in metres", ["--skin", "metres.ply"], "30 mm is the most; give both in mm"),
    ("export", "no ending", ["case", "--out", "a"], "cannot be written as ''"),
]  # fmt: skip
NEEDS = {
    "simulate": ["--out", "out"],
    "close": ["--out", "closed.ply"],
    "make-case": ["--bones", "case/bones", "--out", "out"],
    "fit-atlas": ["--bones", "case/bones", "--atlas", "case/landmarks_before.csv", "--out", "out"],
    "register": ["--on-skin", "case/landmarks_before.csv", "--on-films", PATIENT[1], "--out", "r.ply"],
}  # fmt: skip


@pytest.mark.parametrize("row", REFUSED_OPTIONS, ids=lambda row: f"{row[0]}, {row[1]}")
def test_what_a_command_cannot_take_is_refused_before_any_work(case, refused, tmp_path, monkeypatch, row):
    command, _, flags, *fragments = row
    forbid_meshing(monkeypatch)
    monkeypatch.chdir(tmp_path)
    marks, skin = small_case().landmarks_before, small_case().skin
    write_landmarks("metres.csv", Landmarks(marks.names, marks.points / 1000.0))
    write_surface("metres.ply", Surface(skin.vertices / 1000.0, skin.faces))
    before = sorted(tmp_path.rglob("*"))
    refused([command, *completed(flags, NEEDS.get(command, []))], *fragments)
    assert sorted(path for path in tmp_path.rglob("*") if path.name != "out") == before


FILMS = [
    ("no film", "pa.csv", None, "pa.csv: there is no such file"),
    ("a column less", "pa.csv", "name,u\na,1\n", "the first line must name the columns name,u,v"),
    ("rows of other lengths", "pa.txt", "1 2 3 4\n1 2\n1 2 3 4\n", "pa.txt: cannot be read"),
    ("no source", "pa.txt", "1 0 0 4\n1 0 0 4\n0 0 1 4\n", "must be a regular matrix"),
    ("three columns", "pa.txt", "1 2 3\n4 5 6\n", "pa.txt", "3 by 4"),
    ("not finite", "pa.txt", "1 0 0 0\n0 nan 0 5\n0 0 1 0\n", "pa.txt", "finite"),
    ("other landmarks", "pa.csv", "name,u,v\na,1,2\n", "pa.csv"),
]


@pytest.mark.parametrize("row", FILMS, ids=lambda row: row[0])
def test_broken_films_are_refused(refused, tmp_path, row):
    _, name, text, *fragments = row
    flags = write_films(tmp_path, biplanar(small_case().landmarks_before))
    (tmp_path / name).unlink()
    if text is not None:
        (tmp_path / name).write_text(text, encoding="utf-8")
    refused(["triangulate", *flags, "--out", str(tmp_path / "out.csv")], *fragments)
    assert not (tmp_path / "out.csv").exists()
