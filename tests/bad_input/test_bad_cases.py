"""Broken case folders and crossing surfaces: each ends in one line, and leaves nothing behind."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from support.breaking import content, header, instead, layers, set_point, shape, text
from support.synthetic import sphere
from warp_trunk.cli.simulation import crossings_written
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import read_surface
from warp_trunk.meshing import CrossingError
from warp_trunk.meshing.tetrahedra import tetrahedralize

CASES = [
    ("no folder", lambda folder: os.rename(folder, folder.with_name("gone")), "there is no such folder"),
    ("no case.toml", lambda f: (f / "case.toml").unlink(), "case.toml: there is no such file"),
    ("no skin", lambda f: (f / "skin.ply").unlink(), "skin.ply: there is no such file"),
    ("no bones", lambda f: [path.unlink() for path in (f / "bones").iterdir()],
     "bones: there is no surface in it"),
    ("skin is a folder", lambda f: ((f / "skin.ply").unlink(), (f / "skin.ply").mkdir()), "skin.ply: there is no"),
    ("skin is a pipe", lambda f: ((f / "skin.ply").unlink(), os.mkfifo(f / "skin.ply")), "skin.ply: there is no"),
    ("landmarks are a pipe", lambda f: _pipe(f / "landmarks_after.csv"),
     "landmarks_after.csv: is no regular file"),
    ("case.toml never ends", lambda f: _link(f / "case.toml", Path("/dev/zero")), "case.toml: lies outside the"),
    ("TOML that is none", content("case.toml", lambda b: b"name ="), "case.toml", "cannot be read as TOML"),
    ("no UTF-8", content("case.toml", lambda b: b'name = "\xff"'), "case.toml: is no text in UTF-8"),
    ("10 MB", content("case.toml", lambda b: b"#" * 10**7), "case.toml: has 10 MB, 1 MB is the most"),
    ("deep", content("case.toml", lambda b: b"name = " + b"[" * 5000 + b"]" * 5000), "cannot be read as TOML"),
    ("unknown axes", header('axes = "LPX"'), "case.toml", "LPX"),
    ("axes of another hand", header('axes = "RAS"'), "axes", "correct the axes"),
    ("a number too large", text("case.toml", lambda t: _constant(t, "density", "1" + "0" * 400)),
     "must be a number"),
    ("incompressible", text("case.toml", lambda t: _constant(t, "poisson_ratio", 0.5)),
     "from 0 to 0.499, not 0.5"),
    ("three columns", header('landmark_columns = ["a", "b", "c"]'), "must be four different names"),
    ("columns of another file", header('landmark_columns = ["name", "x", "y", "w"]'), "must name the columns"),
    ("thickness elsewhere", layers('skin_thickness = "../secret.txt"'), "lies outside the case folder", "copy it"),
    ("thickness at the root", layers('fat_thickness = "/etc/hostname"'), "/etc/hostname: lies outside"),
    ("thickness with a null", layers('fat_thickness = "a\\u0000b"'), "lies outside the case folder"),
    ("labels elsewhere", layers('mesh = "../m.vtu"'), "m.vtu: lies outside the case folder"),
    ("no landmarks", lambda f: (f / "landmarks_before.csv").unlink(), "before.csv: there is no such file"),
    ("landmarks twice", lambda f: (f / "landmarks_after.fcsv").write_text(""), "landmarks_after.fcsv: there is"),
    ("semicolons", text("landmarks_before.csv", lambda t: t.replace(",", ";")), "must name the columns"),
    ("a field less", set_point("after", "asis_left", "1,2"), "line", "a landmark is name,x,y,z"),
    ("a word", set_point("after", "asis_left", "1,2,here"), "z of 'asis_left' must be a number, not 'here'"),
    ("underscores", set_point("after", "asis_left", "1_0,2,3"), "must be a number, not '1_0'"),
    ("infinite", set_point("after", "asis_left", "inf,2,3"), "x of 'asis_left' must be finite"),
    ("a landmark less", text("landmarks_after.csv", lambda t: "\n".join(t.split("\n")[:-2])), "is missing"),
    ("a landmark without bone", lambda f: (f / "bones" / "T7.ply").unlink(), "needs a bone that its name begins"),
    ("landmarks in metres", text("landmarks_before.csv", lambda t: _scaled(t, 1e-3)), "landmarks_before.csv"),
    ("landmarks mirrored", text("landmarks_before.csv", lambda t: _scaled(t, -1, 1, 1)), "asis_left left of"),
    ("landmarks of noise", content("landmarks_after.csv", lambda b: bytes(range(256))), "is no text in UTF-8"),
    ("a name of two lines", set_point("after", "asis_left", '1,2,3\n"a\nb",1,2,3'), "a name has no line breaks"),
    (
        "Slicer's file without axes",
        instead("landmarks_after.csv", "landmarks_after.fcsv", b"# columns = id,x,y,z,label\n1,0,0,0,a\n"),
        "landmarks_after.fcsv: does not say",
    ),
    ("Slicer's file with true for a number", instead("landmarks_after.csv", "landmarks_after.mrk.json",
     b'{"markups": [{"controlPoints": [{"label": "a", "position": [true, 1, 2]}]}]}'),
     "Expected `float`, got `bool`"),
    ("Slicer's file too deep", instead("landmarks_after.csv", "landmarks_after.mrk.json", b"[" * 10**5),
     "cannot be read as markups"),
    ("a link out of the folder", lambda f: _moved_out(f, "skin.ply"), "skin.ply: lies outside the case folder"),
    ("a bone linked from elsewhere", lambda f: _moved_out(f, "bones/T7.ply"), "T7.ply: lies outside"),
    ("links in a circle", lambda f: _link(f / "case.toml", f / "case.toml"), "case.toml: lies outside"),
]  # fmt: skip


def _pipe(path):
    path.unlink()
    os.mkfifo(path)


def _link(path, target):
    path.unlink()
    path.symlink_to(target)


def _moved_out(folder, name):
    elsewhere = folder.parent / "elsewhere.ply"
    (folder / name).rename(elsewhere)
    (folder / name).symlink_to(elsewhere)


def _constant(toml, name, value):
    return "\n".join(f"{name} = {value}" if line.startswith(name) else line for line in toml.split("\n"))


def _scaled(table, *by):
    head, *rows = table.strip().split("\n")
    x = by * 3 if len(by) == 1 else by
    cells = [row.split(",") for row in rows]
    return "\n".join(
        [head, *(",".join([n, *(repr(float(c) * b) for c, b in zip(p, x, strict=True))]) for n, *p in cells)]
    )


@pytest.mark.parametrize("row", CASES, ids=lambda row: row[0])
def test_a_broken_case_is_refused_in_one_line(case, refused, tmp_path, row):
    _, spoil, *fragments = row
    spoil(case)
    refused(["simulate", str(case), "--out", str(tmp_path / "out")], *fragments)
    assert not (tmp_path / "out").exists()


def pulled_through(vertices, faces):
    vertices[np.argmax(vertices[:, 1])] -= [0.0, 250.0, 0.0]  # a point of the back, out of the front
    return vertices, faces


def test_triangles_of_a_skin_that_cross_are_written(case, refused, tmp_path):
    shape("skin.ply", pulled_through)(case)
    out = tmp_path / "out"
    line = refused(["simulate", str(case), "--out", str(out)], "must not cross itself", "triangles do")
    (path,) = out.iterdir()
    assert line.endswith(f"look at the triangles that cross in {path}")
    crossing = read_surface(path)
    assert 2 <= len(crossing.faces) < 200
    assert np.ptp(crossing.vertices[:, 1]) > 100.0  # from the back to the front


def test_what_stops_tetgen_is_named_and_written(tmp_path):
    skin, bone = sphere(10.0), sphere(4.0)
    through = Surface(bone.vertices + np.array([0.0, 8.0, 0.0]), bone.faces)
    rule = r"TetGen cannot fill the space .*triangles cross others, the first near \(.*repair the skin there"
    with pytest.raises(CrossingError, match=rule):
        tetrahedralize(skin, through, 5000)
    with pytest.raises(InputError, match=r"look at .*crossings\.ply"), crossings_written(tmp_path / "out"):
        tetrahedralize(skin, through, 5000)
    crossing = read_surface(tmp_path / "out" / "crossings.ply")
    # they cross in a circle, at y = (100 - 16 + 64) / 16
    np.testing.assert_allclose(crossing.vertices[:, 1], 9.25, atol=3.0)
    assert len(crossing.faces) < 0.5 * (len(skin.faces) + len(bone.faces))


def test_a_folder_that_cannot_be_written_leaves_the_places(tmp_path):
    (tmp_path / "file").write_text("")
    tetrahedron = Surface(np.eye(4)[:, :3], np.array([[0, 2, 1], [0, 1, 3]], dtype=np.int32))
    with pytest.raises(CrossingError, match="here"), crossings_written(tmp_path / "file"):
        raise CrossingError("here", tetrahedron, np.array([[0, 1]]))
