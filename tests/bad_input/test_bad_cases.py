"""Broken case folders, surfaces and motions of bones: each ends in one line, and leaves nothing behind."""

import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from support.breaking import content, header, instead, ply, set_point, shape, text
from support.shown import check_shown
from support.small_case import part_case, small_case
from support.synthetic import sphere
from warp_trunk.case import write_case
from warp_trunk.case.motions import Motion
from warp_trunk.cli.simulate import crossings_written
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import read_surface, write_surface
from warp_trunk.meshing import CrossingError
from warp_trunk.meshing.tetrahedra import cavity_points, tetrahedralize

SKIN, T7 = small_case().skin, small_case().bones["T7"]
FLAT = "0 0 0\n1 0 0\n0 1 0\n"


def with_a_line(vertices, faces):
    """A vertex in the middle of an edge, in no triangle that has an area."""
    a, b, c = faces[0]
    other = next(i for i, f in enumerate(faces) if i and a in f and b in f)
    d = next(v for v in faces[other] if v not in (a, b))
    middle, n = 0.5 * (vertices[a] + vertices[b]), len(vertices)
    new = [[a, b, n], [b, c, n], [c, a, n], [b, a, d]]  # the first is a line
    return np.vstack([vertices, middle]), np.vstack([np.delete(faces, [0, other], axis=0), new])


def tiny_t7():
    """The bone made small, at a place well inside it."""
    return Surface(0.02 * (T7.vertices - T7.vertices.mean(axis=0)) + cavity_points(T7)[0], T7.faces)


def pipe(path):
    """Makes a named pipe, or what is no file either on Windows."""
    if sys.platform == "win32":
        path.mkdir()
    else:
        os.mkfifo(path)


def replaced(name, make):
    """Makes something else in the place of a file."""

    def spoil(folder):
        (folder / name).unlink()
        make(folder / name)

    return spoil


def scaled(*by):
    """The landmarks before surgery with coordinates in another unit or mirrored."""

    def change(table):
        names, *rows = table.strip().split("\n")
        cells = [row.split(",") for row in rows]
        moved = [f"{name},{','.join(map(str, np.multiply(by, list(map(float, xyz)))))}" for name, *xyz in cells]
        return "\n".join([names, *moved])

    return text("landmarks_before.csv", change)


CASES = {
    "no folder": lambda folder: os.rename(folder, folder.with_name("gone")),
    "a result": lambda f: [(f / "skin.ply").unlink(), (f / "case.toml").rename(f / "summary.json")],
    "no skin, no header": lambda f: [(f / name).unlink() for name in ("skin.ply", "case.toml")],
    "not written to its end": lambda f: (f / "case.toml").rename(f / "case.partial.toml"),
    "a bone in small letters": lambda f: (f / "bones" / "T7.ply").rename(f / "bones" / "t7.ply"),
    "no bones": lambda f: [path.unlink() for path in (f / "bones").iterdir()],
    "landmarks are a pipe": replaced("landmarks_after.csv", pipe),
    "case.toml never ends": replaced("case.toml", lambda path: path.symlink_to("/dev/zero")),
    "TOML that is none": content("case.toml", lambda b: b"name ="),
    "10 MB": content("case.toml", lambda b: b"#" * 10**7),
    "unknown axes": header('axes = "LPX"'),
    "axes of another hand": header('axes = "RAS"'),
    "a number too large": text("case.toml", lambda t: t.replace("density = ", "density = 1" + "0" * 400)),
    "thickness elsewhere": text("case.toml", lambda t: t + '\n[layers]\nskin_thickness = "../a.txt"\n'),
    "no landmarks": lambda f: (f / "landmarks_before.csv").unlink(),
    "landmarks twice": lambda f: (f / "landmarks_after.fcsv").write_bytes(b""),
    "other columns": text("landmarks_before.csv", lambda t: t.replace("name", "who")),
    "a skin in capitals": lambda f: (f / "skin.ply").rename(f / "Skin.ply"),
    "landmarks by another name": lambda f: (f / "landmarks_before.csv").rename(f / "landmarks.csv"),
    "bones in capitals": lambda f: [(f / "bones").rename(f / "Bones")],
    "a folder for a skin": lambda f: [(f / "skin.ply").unlink(), (f / "skin.ply").mkdir()],
    "a field less": set_point("after", "asis_left", "1,2"),
    "a word": set_point("after", "asis_left", "1,2,here"),
    "infinite": set_point("after", "asis_left", "inf,2,3"),
    "a landmark less": text("landmarks_after.csv", lambda t: "\n".join(t.split("\n")[:-2])),
    "a landmark without bone": lambda f: (f / "bones" / "T7.ply").unlink(),
    "landmarks in metres": scaled(1e-3, 1e-3, 1e-3),
    "landmarks mirrored": scaled(-1, 1, 1),
    "a name of two lines": set_point("after", "asis_left", '1,2,3\n"a\nb",1,2,3'),
    "Slicer's file without axes": instead(
        "landmarks_after.csv", "landmarks_after.fcsv", b"# columns = id,x,y,z,label\n1,0,0,0,a\n"),
    "Slicer's file with true for a number": instead(
        "landmarks_after.csv", "landmarks_after.mrk.json",
        b'{"markups": [{"controlPoints": [{"label": "a", "position": [true, 1, 2]}]}]}'),
    "Slicer's file too deep": instead("landmarks_after.csv", "landmarks_after.mrk.json", b"[" * 10**5),
    "noise": content("skin.ply", lambda b: bytes(range(256)) * 9),
    "cut in half": content("skin.ply", lambda b: b[: len(b) // 2]),
    "STL called PLY": content("skin.ply", lambda b: b"solid a\nendsolid a\n"),
    "a billion in 1 kB": content("skin.ply", lambda b: ply(10**9, 10**9)),
    "text PLY without its last face": content(
        "bones/T7.ply", lambda b: ply(3, 2, "ascii", f"{FLAT}3 0 1 2\n".encode())),
    "STL text cut off": instead(
        "skin.ply", "skin.stl", b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n"),
    "OBJ with a vertex of two numbers": instead("bones/T7.ply", "bones/T7.obj", b"v 0 0 0\nv 1 0\nf 1 2 1\n"),
    "GLB that is none": instead("skin.ply", "skin.glb", b"glTF"),
    "a format that is not read": instead("skin.ply", "skin.dae", b"<COLLADA/>"),
    "VTP of a volume": instead("skin.ply", "skin.vtp", b'<VTKFile type="UnstructuredGrid"/>'),
    "VTK with more points than bytes": instead(
        "skin.ply", "skin.vtk",
        b"# vtk DataFile Version 4.2\na\nBINARY\nDATASET POLYDATA\nPOINTS 1000000000 double\n"),
    "not finite": shape("skin.ply", lambda v, f: (np.where((v == v[3]).all(axis=1, keepdims=True), np.nan, v), f)),
    "1e308": shape("bones/T7.ply", lambda v, f: (v * 1e300, f)),
    "no triangle": shape("bones/T7.ply", lambda v, f: (v, f[:0])),
    "a hole": shape("skin.ply", lambda v, f: (v, f[1:])),
    "a triangle twice": shape("skin.ply", lambda v, f: (v, np.vstack([f, f[:1]]))),
    "inside out": shape("skin.ply", lambda v, f: (v, f[:, ::-1])),
    "two pieces": shape("skin.ply",
        lambda v, f: (np.vstack([v, 0.01 * v + [0, 0, 200]]), np.vstack([f, f + len(v)]))),
    "a line for a triangle": shape("skin.ply", with_a_line),
    "metres": shape("skin.ply", lambda v, f: (v / 1000.0, f)),
    "bone elsewhere": shape("bones/L3.ply", lambda v, f: (v + np.array([500, 0, 0]), f)),
    "bone through the skin": shape("bones/sternum.ply", lambda v, f: (v - [0, 40, 0], f)),
    "bone inside another": lambda folder: write_surface(folder / "bones" / "T7x.ply", tiny_t7()),
    "the same bone twice": lambda f: (f / "bones" / "T7.stl").write_bytes(b""),
    "a name with a line break": lambda f: (f / "bones" / "T7.ply").rename(f / "bones" / "T\n7.ply"),
}  # fmt: skip


def test_lines_of_broken_cases_are_as_accepted(good_case, refused_row, tmp_path):
    lines = []
    for name, spoil in CASES.items():
        case = Path(shutil.copytree(good_case, tmp_path / "case"))
        spoil(case)
        lines.append(refused_row(name, ["simulate", case, "--out", tmp_path / "out"]))
        assert not (tmp_path / "out").exists()
        shutil.rmtree(case, ignore_errors=True)
    check_shown("refused_cases", lines)


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
    (tmp_path / "file").write_text("", encoding="utf-8")
    tetrahedron = Surface(np.eye(4)[:, :3], np.array([[0, 2, 1], [0, 1, 3]], dtype=np.int32))
    with pytest.raises(CrossingError, match="here"), crossings_written(tmp_path / "file"):
        raise CrossingError("here", tetrahedron, np.array([[0, 1]]))


TFM = "#Insight Transform File V1.0\n#Transform 0\nTransform: {}\nParameters: {}\nFixedParameters: 0 0 0\n"
IDENTITY = "1 0 0 0 1 0 0 0 1 "
FILES = {
    "mirrored.txt": "-1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1",
    "other.tfm": TFM.format("BSplineTransform_double_3_3", IDENTITY + "0 0 0"),
    "short.tfm": TFM.format("AffineTransform_double_3_3", IDENTITY),
    "frame.txt": "1 0 0 0\n0 1 0 0\n0 0 1 1500\n0 0 0 1",
}
FRONT = "[front]\n"
MOTIONS = {
    "no TOML": "[front\n",
    "nothing": "",
    "unknown bone": "[frnt]\ntranslation = [1, 0, 0]\n",
    "unknown key": FRONT + "translate = [1, 0, 0]\n",
    "not finite": FRONT + "translation = [nan, 0, 0]\n",
    "no motion": FRONT + "large = true\n",
    "two motions": FRONT + "translation = [1, 0, 0]\nfollows = { core = 0.5 }\n",
    "rotation without a point": FRONT + "rotation = { degrees = 2, axis = [1, 0, 0] }\n",
    "too far": FRONT + "translation = [0, 0, -61]\n",
    "another frame": FRONT + 'transform = "frame.txt"\nlarge = true\n',
    "no file": FRONT + 'transform = "none.tfm"\n',
    "mirrored": FRONT + 'transform = "mirrored.txt"\n',
    "another transform": FRONT + 'transform = "other.tfm"\n',
    "nine parameters": FRONT + 'transform = "short.tfm"\n',
    "follows a stranger": FRONT + "follows = { spine = 1.0 }\n",
    "shares above 1": FRONT + "follows = { core = 0.7, left = 0.7 }\n",
    "a circle": FRONT + "follows = { left = 1.0 }\n[left]\nfollows = { front = 1.0 }\n",
    "passes through": FRONT + "translation = [0, 35, 0]\n",
}  # fmt: skip


@pytest.fixture
def part_folder(tmp_path):
    folder = tmp_path / "part"
    write_case(folder, part_case(front=Motion(translation=(0.0, -1.0, 0.0))))
    for name, said in FILES.items():
        (folder / name).write_text(said, encoding="utf-8")
    return folder


def test_lines_of_broken_motions_are_as_accepted(part_folder, refused_row, tmp_path):
    lines, file = [], part_folder / "motions.toml"
    for name, said in MOTIONS.items():
        file.write_text(said, encoding="utf-8")
        lines.append(refused_row(name, ["simulate", part_folder, "--out", tmp_path / "out"]))
    file.write_text(FRONT + "translation = [0, -1, 0]\n", encoding="utf-8")
    files = [word for name in ("a", "b/a") for word in ("--motions", tmp_path / f"{name}.toml")]
    for words in (["--bands"], ["--bones", "spline"], ["--align-pelvis"], files):
        lines.append(refused_row(words[0], ["simulate", part_folder, "--out", tmp_path / "out", *words]))
    assert not (tmp_path / "out").exists()
    check_shown("refused_motions", lines)
