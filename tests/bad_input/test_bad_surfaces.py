"""Surfaces that a clinic may deliver, broken: each row ends in one line, and leaves nothing behind."""

import struct

import numpy as np
import pytest

from support.breaking import content, instead, ply, shape
from support.small_case import small_case
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import write_surface
from warp_trunk.meshing.tetrahedra import cavity_points

SKIN, T7 = small_case().skin, small_case().bones["T7"]
N = len(SKIN.vertices)
FLAT = "0 0 0\n1 0 0\n0 1 0\n"


def with_a_line(vertices, faces):
    """A vertex in the middle of an edge, in no triangle that has an area."""
    a, b, c = faces[0]
    other = next(i for i, f in enumerate(faces) if i and a in f and b in f)
    d = next(v for v in faces[other] if v not in (a, b))
    middle, n = 0.5 * (vertices[a] + vertices[b]), len(vertices)
    rest = np.delete(faces, [0, other], axis=0)
    new = [[a, b, n], [b, c, n], [c, a, n], [b, a, d]]  # the first is a line
    return np.vstack([vertices, middle]), np.vstack([rest, new]).astype(np.int32)


def tiny_t7():
    """The bone made small, at a place well inside it."""
    return Surface(0.02 * (T7.vertices - T7.vertices.mean(axis=0)) + cavity_points(T7)[0], T7.faces)


# fmt: off
SURFACES = [
    ("empty", content("skin.ply", lambda b: b""), "skin.ply", "cannot be read as a surface"),
    ("noise", content("skin.ply", lambda b: bytes(range(256)) * 9), "skin.ply", "cannot be read",
     "write it again"),
    ("cut in half", content("skin.ply", lambda b: b[: len(b) // 2]), "skin.ply", "cannot be read as a surface"),
    ("last byte lost", content("skin.ply", lambda b: b[:-1]), "skin.ply", "cannot be read as a surface"),
    ("STL called PLY", content("skin.ply", lambda b: b"solid a\nendsolid a\n"), "skin.ply", "header of a PLY"),
    ("a billion in 1 kB", content("skin.ply", lambda b: ply(10**9, 10**9)),
     "the header says 2000000000 elements"),
    ("a billion in text", content("skin.ply", lambda b: ply(10**9, 1, "ascii", FLAT.encode())),
     "header says 1000000001"),
    ("text PLY without its last face", content("bones/T7.ply", lambda b: ply(3, 2, "ascii",
     f"{FLAT}3 0 1 2\n".encode())), "T7.ply", "it is cut off"),
    ("PLY with half a corner", content("bones/T7.ply", lambda b: ply(3, 1, "ascii",
     f"{FLAT}3 0 1.5 2\n".encode())), "T7.ply", "1.5"),
    ("PLY with a face of 200 corners", content("bones/T7.ply", lambda b: b[:-13] + b"\xc8" + b[-12:]), "T7.ply",
     "it is cut off"),
    ("a billion triangles in an STL", instead("skin.ply", "skin.stl", b" " * 80 + struct.pack("<I",
     10**9) + b" " * 50), "skin.stl", "cannot be read as a surface"),
    ("STL text cut off", instead("skin.ply", "skin.stl",
     b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n"), "skin.stl",
     "the file is cut off or damaged"),
    ("STL text with a word for a number", instead("skin.ply", "skin.stl",
     b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 x 0\nvertex 0 1 0\n"
     b"endloop\nendfacet\nendsolid a\n",
     ), "skin.stl", "unmatched data"),
    ("OBJ with a vertex of two numbers", instead("bones/T7.ply", "bones/T7.obj", b"v 0 0 0\nv 1 0\nf 1 2 1\n"),
     "T7.obj", "line 2: a vertex needs x, y and z"),
    ("OBJ with corner 0", instead("bones/T7.ply", "bones/T7.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n"),
     "line 4: there is no vertex 0"),
    ("OBJ with decimal commas", instead("bones/T7.ply", "bones/T7.obj",
     b"v 0,5 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), "T7.obj", "'0,5'"),
    ("OBJ that counts back too far", instead("bones/T7.ply", "bones/T7.obj", b"v 0 0 0\nf -1 -2 -3\n"),
     "there is no vertex -2"),
    ("GLB that is none", instead("skin.ply", "skin.glb", b"glTF"), "skin.glb", "does not begin as a GLB"),
    ("a format that is not read", instead("skin.ply", "skin.dae", b"<COLLADA/>"), "skin.ply", "there is no such"),
    ("VTP of a volume", instead("skin.ply", "skin.vtp", b'<VTKFile type="UnstructuredGrid"/>'), "skin.vtp",
     "must hold PolyData, not 'UnstructuredGrid'; extract the surface"),
    ("VTP with entities", instead("skin.ply", "skin.vtp",
     b'<!DOCTYPE a [<!ENTITY b "bb">]><VTKFile type="PolyData"/>'), "it defines entities"),
    ("VTK with more points than bytes", instead("skin.ply", "skin.vtk",
     b"# vtk DataFile Version 4.2\na\nBINARY\nDATASET POLYDATA\nPOINTS 1000000000 double\n", ),
     "it says 3000000000 numbers, 0 bytes are left"),
    ("VTK of a volume", instead("skin.ply", "skin.vtk",
     b"# vtk DataFile Version 4.2\na\nASCII\nDATASET UNSTRUCTURED_GRID\n"), "must hold POLYDATA"),
    ("not finite", shape("skin.ply", lambda v, f: (np.where(v == v.max(), np.nan, v), f)), "not finite"),
    ("1e308", shape("bones/T7.ply", lambda v, f: (v * 1e300, f)), "T7.ply", "coordinates may be 1e+07 at most"),
    ("all at one point", shape("skin.ply", lambda v, f: (v * 1e-310, f)), "skin.ply", "mm tall"),
    ("no triangle", shape("bones/T7.ply", lambda v, f: (v, f[:0])), "T7.ply", "points without triangles"),
    ("three triangles", shape("skin.ply", lambda v, f: (v, f[:3])), "skin.ply", "must be closed"),
    ("a hole", shape("skin.ply", lambda v, f: (v, f[1:])), "skin.ply", "it is open along", "3 edges"),
    ("a triangle twice", shape("skin.ply", lambda v, f: (v, np.vstack([f, f[:1]]))), "share an edge"),
    ("a corner twice", shape("skin.ply", lambda v, f: (v, np.vstack([f, [[0, 0, 1]]]))), "has one vertex twice"),
    ("a vertex to spare", shape("skin.ply", lambda v, f: (np.vstack([v, v[:1]]), f)), "in no triangle"),
    ("inside out", shape("skin.ply", lambda v, f: (v, f[:, ::-1])), "skin.ply", "must be counterclockwise"),
    ("bone inside out", shape("bones/T7.ply", lambda v, f: (v, f[:, ::-1])), "T7.ply", "counterclockwise"),
    ("two pieces", shape("skin.ply", lambda v, f: (np.vstack([v, 0.01 * v + [0, 0, 200]]), np.vstack([f,
     f + N]))), "must be one piece, but has 2; keep the outer one"),
    ("a line for a triangle", shape("skin.ply", with_a_line), "angles of at least 1 degree", "remesh"),
    ("metres", shape("skin.ply", lambda v, f: (v / 1000.0, f)), "is 0.575 mm tall", 'set units = "m"'),
    ("lying", shape("skin.ply", lambda v, f: (v[:, [1, 2, 0]], f)), "mm", "skin.ply"),
    ("bone in metres", shape("bones/T7.ply", lambda v, f: (v / 1000.0, f)), "T7.ply"),
    ("bone elsewhere", shape("bones/L3.ply", lambda v, f: (v + np.array([500, 0, 0]), f)), "L3.ply",
     "mm outside", "one frame"),
    ("bone through the skin", shape("bones/sternum.ply", lambda v, f: (v - [0, 40, 0], f)), "5 mm is allowed"),
    ("bone inside another", lambda folder: write_surface(folder / "bones" / "T7x.ply", tiny_t7()),
     "T7x.ply: lies completely inside", "T7.ply", "remove one of them"),
    ("the same bone twice", lambda f: (f / "bones" / "T7.stl").write_bytes(b""), "T7.stl", "T7.ply beside it"),
    ("a name with a line break", lambda f: (f / "bones" / "T7.ply").rename(f / "bones" / "T\n7.ply"), "T7"),
]
# fmt: on


@pytest.mark.parametrize("row", SURFACES, ids=lambda row: row[0])
def test_a_broken_surface_is_refused_in_one_line(case, refused, tmp_path, row):
    _, spoil, *fragments = row
    spoil(case)
    refused(["simulate", str(case), "--out", str(tmp_path / "out")], *fragments)
    assert not (tmp_path / "out").exists()
