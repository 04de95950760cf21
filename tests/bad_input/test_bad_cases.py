"""Broken case folders, surfaces and motions of bones: each ends in one line, and leaves nothing behind."""

import os
import sys

import numpy as np
import pytest

from support.breaking import content, header, instead, ply, set_point, shape, text
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


# fmt: off
CASES = [
    ("no folder", lambda folder: os.rename(folder, folder.with_name("gone")), "there is no such folder"),
    ("a result", lambda f: [(f / "skin.ply").unlink(), (f / "case.toml").rename(f / "summary.json")],
     "is no case folder; it is a result; report, view"),
    ("no skin, no header", lambda f: [(f / name).unlink() for name in ("skin.ply", "case.toml")],
     "is no case folder, as it has no skin.ply; add what is missing"),
    ("not written to its end", lambda f: (f / "case.toml").rename(f / "case.partial.toml"),
     "case.toml: is missing, as writing this case did not end"),
    ("a bone in small letters", lambda f: (f / "bones" / "T7.ply").rename(f / "bones" / "t7.ply"),
     "t7.ply: a case calls this bone T7; rename the file to T7.ply"),
    ("no bones", lambda f: [path.unlink() for path in (f / "bones").iterdir()],
     "bones: there is no surface in it"),
    ("landmarks are a pipe", replaced("landmarks_after.csv", pipe),
     "landmarks_after.csv: is no regular file"),
    ("case.toml never ends", replaced("case.toml", lambda path: path.symlink_to("/dev/zero")),
     "case.toml: lies outside the"),
    ("TOML that is none", content("case.toml", lambda b: b"name ="), "case.toml", "cannot be read as TOML"),
    ("10 MB", content("case.toml", lambda b: b"#" * 10**7), "case.toml: has 10 MB, 1 MB is the most"),
    ("unknown axes", header('axes = "LPX"'), "case.toml", "LPX"),
    ("axes of another hand", header('axes = "RAS"'), "axes", "correct the axes"),
    ("a number too large", text("case.toml", lambda t: t.replace("density = ", "density = 1" + "0" * 400)),
     "must be a finite number"),
    ("thickness elsewhere", text("case.toml", lambda t: t + '\n[layers]\nskin_thickness = "../a.txt"\n'),
     "lies outside the case folder", "copy it"),
    ("no landmarks", lambda f: (f / "landmarks_before.csv").unlink(), "before.csv: there is no such file"),
    ("landmarks twice", lambda f: (f / "landmarks_after.fcsv").write_bytes(b""), "landmarks_after.fcsv: there is"),
    ("other columns", text("landmarks_before.csv", lambda t: t.replace("name", "who")), "must name the columns"),
    ("a skin in capitals", lambda f: (f / "skin.ply").rename(f / "Skin.ply"), "(did you mean 'Skin.ply'?)"),
    ("landmarks by another name", lambda f: (f / "landmarks_before.csv").rename(f / "landmarks.csv"),
     "before.csv: there is no such file (did you mean 'landmarks.csv'?)"),
    ("bones in capitals", lambda f: [(f / "bones").rename(f / "Bones")], "(did you mean 'Bones'?)"),
    ("a folder for a skin", lambda f: [(f / "skin.ply").unlink(), (f / "skin.ply").mkdir()], "ply: is a folder"),
    ("a field less", set_point("after", "asis_left", "1,2"), "line", "a landmark is name,x,y,z"),
    ("a word", set_point("after", "asis_left", "1,2,here"), "z of 'asis_left' must be a finite", "not 'here'"),
    ("infinite", set_point("after", "asis_left", "inf,2,3"), "x of 'asis_left' must be a finite"),
    ("a landmark less", text("landmarks_after.csv", lambda t: "\n".join(t.split("\n")[:-2])), "is missing"),
    ("a landmark without bone", lambda f: (f / "bones" / "T7.ply").unlink(),
     "and there is no bones/T7.ply; add it"),
    ("landmarks in metres", scaled(1e-3, 1e-3, 1e-3), "landmarks_before.csv"),
    ("landmarks mirrored", scaled(-1, 1, 1), "asis_left left of"),
    ("a name of two lines", set_point("after", "asis_left", '1,2,3\n"a\nb",1,2,3'), "a name of letters"),
    (
        "Slicer's file without axes",
        instead("landmarks_after.csv", "landmarks_after.fcsv", b"# columns = id,x,y,z,label\n1,0,0,0,a\n"),
        "landmarks_after.fcsv: does not say '# CoordinateSystem",
    ),
    ("Slicer's file with true for a number", instead("landmarks_after.csv", "landmarks_after.mrk.json",
     b'{"markups": [{"controlPoints": [{"label": "a", "position": [true, 1, 2]}]}]}'),
     "Expected `float`, got `bool`"),
    ("Slicer's file too deep", instead("landmarks_after.csv", "landmarks_after.mrk.json", b"[" * 10**5),
     "cannot be read as markups"),
    ("noise", content("skin.ply", lambda b: bytes(range(256)) * 9), "skin.ply", "cannot be read",
     "write it again"),
    ("cut in half", content("skin.ply", lambda b: b[: len(b) // 2]), "skin.ply", "cannot be read as a surface"),
    ("STL called PLY", content("skin.ply", lambda b: b"solid a\nendsolid a\n"), "skin.ply", "header of a PLY"),
    ("a billion in 1 kB", content("skin.ply", lambda b: ply(10**9, 10**9)),
     "the header says 2000000000 elements"),
    ("text PLY without its last face", content("bones/T7.ply", lambda b: ply(3, 2, "ascii",
     f"{FLAT}3 0 1 2\n".encode())), "T7.ply", "it is cut off"),
    ("STL text cut off", instead("skin.ply", "skin.stl",
     b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n"), "skin.stl",
     "the file is cut off or damaged"),
    ("OBJ with a vertex of two numbers", instead("bones/T7.ply", "bones/T7.obj", b"v 0 0 0\nv 1 0\nf 1 2 1\n"),
     "T7.obj", "line 2: a vertex needs x, y and z"),
    ("GLB that is none", instead("skin.ply", "skin.glb", b"glTF"), "skin.glb", "does not begin as a GLB"),
    ("a format that is not read", instead("skin.ply", "skin.dae", b"<COLLADA/>"), "skin.ply", "there is no such"),
    ("VTP of a volume", instead("skin.ply", "skin.vtp", b'<VTKFile type="UnstructuredGrid"/>'), "skin.vtp",
     "must hold PolyData, not 'UnstructuredGrid'; extract the surface"),
    ("VTK with more points than bytes", instead("skin.ply", "skin.vtk",
     b"# vtk DataFile Version 4.2\na\nBINARY\nDATASET POLYDATA\nPOINTS 1000000000 double\n", ),
     "it says 3000000000 numbers, 0 bytes are left"),
    ("not finite", shape("skin.ply", lambda v, f: (np.where(v == v.max(), np.nan, v), f)), "not finite"),
    ("1e308", shape("bones/T7.ply", lambda v, f: (v * 1e300, f)), "T7.ply", "coordinates may be 1e+07 at most"),
    ("no triangle", shape("bones/T7.ply", lambda v, f: (v, f[:0])), "T7.ply", "points without triangles"),
    ("a hole", shape("skin.ply", lambda v, f: (v, f[1:])), "skin.ply", "it is open along", "3 edges"),
    ("a triangle twice", shape("skin.ply", lambda v, f: (v, np.vstack([f, f[:1]]))), "share an edge"),
    ("inside out", shape("skin.ply", lambda v, f: (v, f[:, ::-1])), "skin.ply", "must be counterclockwise"),
    ("two pieces", shape("skin.ply", lambda v, f: (np.vstack([v, 0.01 * v + [0, 0, 200]]), np.vstack([f,
     f + len(v)]))), "must be one piece, but has 2; keep the outer one"),
    ("a line for a triangle", shape("skin.ply", with_a_line), "angles of at least 1 degree", "remesh"),
    ("metres", shape("skin.ply", lambda v, f: (v / 1000.0, f)), "is 0.575 mm tall",
     "the bones are in mm, and this file seems to be in m: write it in mm"),
    ("bone elsewhere", shape("bones/L3.ply", lambda v, f: (v + np.array([500, 0, 0]), f)), "L3.ply",
     "mm outside", "one frame"),
    ("bone through the skin", shape("bones/sternum.ply", lambda v, f: (v - [0, 40, 0], f)), "5 mm is allowed"),
    ("bone inside another", lambda folder: write_surface(folder / "bones" / "T7x.ply", tiny_t7()),
     "T7x.ply: lies completely inside", "T7.ply", "remove one of them"),
    ("the same bone twice", lambda f: (f / "bones" / "T7.stl").write_bytes(b""), "T7.stl", "T7.ply beside it"),
    ("a name with a line break", lambda f: (f / "bones" / "T7.ply").rename(f / "bones" / "T\n7.ply"), "T7"),
]
# fmt: on


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
    for name, said in FILES.items():
        (folder / name).write_text(said, encoding="utf-8")
    return folder


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_broken_motions_are_refused_in_one_line(part_folder, refused, tmp_path, row):
    _, text, *fragments = row
    (part_folder / "motions.toml").write_text(text, encoding="utf-8")
    refused(["simulate", str(part_folder), "--out", str(tmp_path / "out")], *fragments)
    assert not (tmp_path / "out").exists()


def test_options_that_need_landmarks_are_refused(part_folder, refused, tmp_path):
    (part_folder / "motions.toml").write_text(FRONT + "translation = [0, -1, 0]\n", encoding="utf-8")
    for option in (["--bands"], ["--bones", "spline"], ["--align-pelvis"]):
        refused(["simulate", str(part_folder), "--out", str(tmp_path / "out"), *option], option[0], "leave it out")


def test_the_same_file_name_twice_is_refused(part_folder, refused, tmp_path):
    files = [str(tmp_path / "a.toml"), str(part_folder / "a.toml")]
    words = [word for file in files for word in ("--motions", file)]
    refused(["simulate", str(part_folder), *words], "a name of its own")
