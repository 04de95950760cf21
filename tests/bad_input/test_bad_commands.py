"""Arguments, results, films, scans and meshes that are not what a command needs: one line, nothing left behind."""

import json
import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from support.asserting import forbid_meshing
from support.biplanar import biplanar, write_films
from support.breaking import content, ply
from support.report_results import write_small_result
from support.shown import check_shown
from support.small_case import small_case
from warp_trunk.case.landmarks import Landmarks, write_landmarks
from warp_trunk.cli import main
from warp_trunk.cli.output import FILE_ERROR
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import write_surface


def summary(change):
    """Changes the summary of a result."""

    def spoil(folder: Path) -> None:
        said = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        change(said)
        (folder / "summary.json").write_text(json.dumps(said), encoding="utf-8")

    return spoil


RESULTS = {
    "no summary": ("report", lambda f: (f / "summary.json").unlink()),
    "a deep summary": ("report", content("summary.json", lambda _: b'{"parameters": ' + b"[" * 10**5)),
    "of another version": ("report", summary(lambda s: s.pop("tissues"))),
    "unknown status": ("report", summary(lambda s: s.update(status="FINE"))),
    "no increment": ("report", summary(lambda s: s.update(increments=[]))),
    "no skin": ("report", lambda f: (f / "predicted_skin.ply").unlink()),
    "skin cut off": ("report", content("predicted_skin.ply", lambda _: ply(10**9, 1))),
    "other landmarks": ("report", content("landmarks_after.csv", lambda _: b"name,x,y,z\na,1,2,3\n")),
    "no mesh": ("export", lambda f: (f / "trunk.vtu").unlink()),
    "mesh cut off": ("export", content("trunk.vtu", lambda b: b[:3000])),
    "entities": ("export", content("trunk.vtu", lambda b: b'<!DOCTYPE a [<!ENTITY b "b">]>' + b)),
    "another program's": ("export", content("trunk.vtu", lambda b: b.replace(b"skin_vertex", b"something__"))),
}  # fmt: skip


def test_lines_of_broken_results_are_as_accepted(refused_row, tmp_path):
    lines, good = [], write_small_result(tmp_path / "good")
    for name, (command, spoil) in RESULTS.items():
        folder = Path(shutil.copytree(good, tmp_path / "result"))
        spoil(folder)
        lines.append(refused_row(name, [command, folder, "--out", tmp_path / "out.inp"]))
        shutil.rmtree(folder)
    assert [path.name for path in tmp_path.iterdir()] == ["good"]
    check_shown("refused_results", lines)


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


PATIENT = "--patient case/landmarks_after.csv"
OPTIONS = {
    "simulate": [
        "case --increments 0", "case --tets 100000000000", "case --tets 100 --no-cache", "case --tolerance nan",
        "case --gravity -9.81", "case --threads -1 --no-cache", "case --from-mesh nowhere.vtu",
        "case --from-mesh case/case.toml", "case --layers mesh", "case --from-mesh a.inp",
        "case --from-mesh a.xdmf", "case --motions a.toml --plan b.toml", "case --tissue-file a.toml",
    ],
    "demo": ["--from-mesh a.vtu", "--from-mesh a.vtu --tets 5000"],
    "view": ["case/skin.ply"],
    "measure": [
        "case/case.toml --case case", "metres.ply --case case", "left.ply --case case", "right.ply --case case",
        "low.ply --case case", "case/skin.ply",
        "open.ply --case case", "inside_out.ply --case case", "tall.ply --case case",
        "case/skin.ply --spine metres.csv --when after", "none.ply --case case",
        "case/skin.ply --case case --out case/measures", "result --case case",
    ],
    "make-case": [
        "--skin case/skin.ply --cobb 1000", "--skin case/skin.ply --correction 70",
        "--skin case/skin.ply --correction -0.5", "--skin case/skin.ply", "--skin case/skin.ply --out case",
    ],
    "close": [
        "case/skin.ply case/skin.ply", "case/skin.ply --transforms none.txt", "metres.ply --cut 1,2,3",
        "case/skin.ply --transforms case/case.toml metres.ply", "case/skin.ply --out no/such/skin.ply",
        "case/skin.ply --out a.txt",
    ],
    "fit-atlas": [
        f"{PATIENT} --nugget inf", "--patient metres.csv", f"{PATIENT} --out metres.csv",
        f"{PATIENT} --skin case/skin.ply", f"{PATIENT} --bones none",
    ],
    "register": ["--skin metres.ply", "--skin case/skin.ply --out no/such/skin.ply"],
    "export": ["case --out a", "case", "case --glb --out a.vtu", "case --out no/such/a.vtu"],
    "cut": [
        "case --bone T8 --plane 0 0 5 0 0 1 --names a b", "case --bone T7 --plane 0 0 5 0 0 1 --names a L3",
        "case --bone T7 --plane 0 0 9000 0 0 1 --names a b", "case --bone T7 --plane 0 0 5 0 0 1 --names a/b c",
    ],
    "landmarks": [
        "case --out a.txt", "case --out no/a.csv", "case --out a.csv --picture a.svg", "none --out a.csv",
        "case --out a.csv --picture no/a.png",
    ],
    "cohort": ["none --out out", "case --out out", ". --out ."],
    "calibrate": [
        ". --free density --out case/a.toml", ". --free theta --out a.txt", ". --free theta --out a.toml",
    ],
    "report": [""],
    "import": ["a.inp --out case", "a.inp --out out --ct a.inp --body a.inp", "a.inp --out out --cut 1,2"],
}  # fmt: skip
NEEDS = {
    "simulate": "--out out", "demo": "--out out", "close": "--out closed.ply",
    "make-case": "--bones case/bones --out out",
    "fit-atlas": "--bones case/bones --atlas case/landmarks_before.csv --out out",
    "register": "--on-skin case/landmarks_before.csv --on-films case/landmarks_after.csv --out r.ply",
}  # fmt: skip


def test_lines_of_what_commands_cannot_take_are_as_accepted(case, refused_row, tmp_path, monkeypatch):
    """They are refused before any work, and leave nothing behind."""
    forbid_meshing(monkeypatch)
    monkeypatch.chdir(tmp_path)
    marks, skin = small_case().landmarks_before, small_case().skin
    write_landmarks("metres.csv", Landmarks(marks.names, marks.points / 1000.0))
    x, y, z = np.eye(3)
    surfaces = {
        "metres": Surface(skin.vertices / 1000.0, skin.faces), "left": skin.moved(skin.vertices + 900.0 * x),
        "right": skin.moved(skin.vertices - 900.0 * x), "low": skin.moved(skin.vertices * (x + y + 0.45 * z)),
        "tall": skin.moved(skin.vertices * (x + y + 2.1 * z)), "open": Surface(skin.vertices, skin.faces[1:]),
        "inside_out": Surface(skin.vertices, skin.faces[:, ::-1].copy()),
    }  # fmt: skip
    for name, surface in surfaces.items():
        write_surface(f"{name}.ply", surface)
    Path("a.toml").write_text("[tisue]", encoding="utf-8")
    Path("b.toml").write_text('uiv = "T7"\nliv = "L3"\n', encoding="utf-8")
    Path("a.inp").write_text("*HEADING\n*Include, input=secret.inp\n", encoding="utf-8")
    Path("secret.inp").write_text("*NODE\n1, 0, 0, 0\n", encoding="utf-8")
    other = '<Xdmf><DataItem Format="HDF">secret.h5:/a</DataItem></Xdmf>'
    Path("a.xdmf").write_text(other, encoding="utf-8")
    write_small_result(tmp_path / "result")
    before, lines = sorted(tmp_path.rglob("*")), []
    for command, rows in OPTIONS.items():
        for row in rows:
            words = completed(row.split(), NEEDS.get(command, "").split())
            lines.append(refused_row(f"{command} {row}", [command, *words]))
    assert sorted(path for path in tmp_path.rglob("*") if path.name != "out") == before
    check_shown("refused_options", lines)


FILMS: dict[str, tuple[str, str | None]] = {
    "no film": ("pa.csv", None),
    "a column less": ("pa.csv", "name,u\na,1\n"),
    "rows of other lengths": ("pa.txt", "1 2 3 4\n1 2\n1 2 3 4\n"),
    "no source": ("pa.txt", "1 0 0 4\n1 0 0 4\n0 0 1 4\n"),
    "three columns": ("pa.txt", "1 2 3\n4 5 6\n"),
    "not finite": ("pa.txt", "1 0 0 0\n0 nan 0 5\n0 0 1 0\n"),
    "other landmarks": ("pa.csv", "name,u,v\na,1,2\n"),
}


def test_lines_of_broken_films_are_as_accepted(refused_row, tmp_path):
    flags, lines = write_films(tmp_path, biplanar(small_case().landmarks_before)), []
    for name, (file, text) in FILMS.items():
        path = tmp_path / file
        good = path.read_bytes()
        path.unlink()
        if text is not None:
            path.write_text(text, encoding="utf-8")
        lines.append(refused_row(name, ["triangulate", *flags, "--out", tmp_path / "out.csv"]))
        path.write_bytes(good)
    for words in ("no/out.csv", "out.csv --limit -1", "out.csv --noise -1"):
        lines.append(refused_row(words, ["triangulate", *flags, *f"--out {tmp_path}/{words}".split()]))
    check_shown("refused_film_files", lines)
