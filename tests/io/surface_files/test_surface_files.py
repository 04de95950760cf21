"""Surfaces from other programs: each format comes back, and opens no other file."""

import json
import struct
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import trimesh
from trimesh.visual import ColorVisuals, TextureVisuals

from support.audited import audited
from support.refusals import refusal
from support.shown import check_shown
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.point_files import read_points
from warp_trunk.io.surface_files import read_stated, read_surface, write_surface

VTK_FILES = sorted((Path(__file__).parents[2] / "support" / "vtk_files").iterdir())
PYRAMID = Surface(
    np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10.1], [10, 10, 0]]),
    np.array([[0, 2, 4], [0, 4, 1], [0, 1, 3], [1, 4, 3], [4, 2, 3], [0, 3, 2]], dtype=np.int32),
)
"""The surface that VTK wrote to `vtk_files`; its base is a quadrilateral, 0 2 4 1."""


def assert_same_triangles(surface: Surface) -> None:
    """As the pyramid's, by the places of their corners."""
    np.testing.assert_allclose(surface.vertices[surface.faces], PYRAMID.vertices[PYRAMID.faces], atol=1e-5)


def assert_same(surface: Surface, other: Surface, atol: float = 0.0) -> None:
    np.testing.assert_allclose(surface.vertices, other.vertices, rtol=0, atol=atol)
    np.testing.assert_array_equal(surface.faces, other.faces)


@pytest.mark.parametrize("path", VTK_FILES, ids=lambda path: path.name)
def test_what_vtk_wrote_is_read(path):
    """Files of VTK 9.7's own writers: text, base 64, appended, raw, compressed in blocks, of both byte orders."""
    assert_same(read_surface(path), PYRAMID)


@pytest.mark.parametrize("ending", ["ply", "stl", "obj", "off", "glb"])
def test_a_format_that_is_written_comes_back(tmp_path, ending):
    write_surface(tmp_path / f"a.{ending}", PYRAMID)
    back = read_surface(tmp_path / f"a.{ending}")
    if ending == "stl":  # vertices come in the order of the triangles
        assert_same_triangles(back)
        assert len(back.vertices) == 5
    else:
        assert_same(back, PYRAMID, 0.0 if ending == "ply" else 1e-5)  # a PLY keeps every bit
    assert [path.name for path in tmp_path.iterdir()] == [f"a.{ending}"]


def test_the_nodes_of_a_glb_move_its_meshes(tmp_path):
    scene = trimesh.Scene()
    box = trimesh.Trimesh(PYRAMID.vertices, PYRAMID.faces, process=False)
    turn = trimesh.transformations.rotation_matrix(np.pi / 2.0, [0, 0, 1])
    turn[0, 3] = 100.0
    scene.add_geometry(box, node_name="whole", transform=trimesh.transformations.translation_matrix([5, 6, 7]))
    scene.add_geometry(box, node_name="part", parent_node_name="whole", transform=turn)
    scene.export(tmp_path / "a.glb")
    x, y, z = PYRAMID.vertices.T
    whole, part = PYRAMID.vertices + np.array([5, 6, 7]), np.column_stack([105.0 - y, x + 6.0, z + 7.0])
    both = Surface(np.concatenate([whole, part]), np.concatenate([PYRAMID.faces, PYRAMID.faces + 5]))
    assert_same(read_surface(tmp_path / "a.glb"), both, 1e-5)


def test_a_texture_does_not_open_a_closed_surface(tmp_path):
    """Each triangle has corners of its own in the texture; trimesh would split the vertices there."""
    lines = [f"v {x} {y} {z}" for x, y, z in PYRAMID.vertices] + ["vt 0 0", "vt 1 0", "vt 0 1"]
    lines += ["usemtl a"] + ["f " + " ".join(f"{c + 1}/{i + 1}" for i, c in enumerate(f)) for f in PYRAMID.faces]
    (tmp_path / "a.obj").write_text("\n".join(lines), encoding="utf-8")
    assert_same(read_surface(tmp_path / "a.obj"), PYRAMID)
    soup = trimesh.Trimesh(
        PYRAMID.vertices[PYRAMID.faces].reshape(-1, 3), np.arange(18).reshape(-1, 3), process=False
    )
    soup.visual = TextureVisuals(uv=np.tile([[0, 0], [1, 0], [0, 1]], (6, 1)))
    soup.export(tmp_path / "a.glb")
    assert len(read_surface(tmp_path / "a.glb").vertices) == 5


QUADS = [(0, 2, 4, 1), (0, 1, 3), (1, 4, 3), (4, 2, 3), (0, 3, 2)]


@pytest.mark.parametrize("order", ["<", ">", "text"])
def test_a_ply_may_hold_polygons_of_several_sizes_and_more(tmp_path, order):
    """As Blender and MeshLab write them: corners with colours, and edges beside the faces."""
    name = {"<": "binary_little_endian", ">": "binary_big_endian", "text": "ascii"}[order]
    head = (
        f"ply\nformat {name} 1.0\ncomment made by hand\nelement vertex 5\nproperty double x\nproperty double y\n"
        "property double z\nproperty uchar red\nelement face 5\nproperty list uchar uint vertex_index\n"
        "property float quality\nelement edge 1\nproperty int vertex1\nproperty int vertex2\nend_header\n"
    )
    if order == "text":
        rows = [f"{x} {y} {z} 7" for x, y, z in PYRAMID.vertices]
        rows += [" ".join(map(str, (len(q), *q, 0.5))) for q in QUADS] + ["0 1"]
        body = "\n".join(rows).encode()
    else:
        body = b"".join(struct.pack(f"{order}3dB", *p, 7) for p in PYRAMID.vertices)
        body += b"".join(struct.pack(f"{order}B{len(q)}If", len(q), *q, 0.5) for q in QUADS)
        body += struct.pack(f"{order}2i", 0, 1)
    (tmp_path / "a.ply").write_bytes(head.encode() + body)
    assert_same(read_surface(tmp_path / "a.ply"), PYRAMID)


@pytest.mark.parametrize("ending", ["obj", "text.stl", "ply"])
def test_text_with_decimal_commas_is_read(tmp_path, ending):
    """As programs write it where commas are decimal; the list of a PLY's faces has a name of theirs, too."""
    text = states("LPS")[ending].decode().replace("vertex_indices", "vertexIndices").replace("10.1", "10,1")
    text = (
        text.replace("vertex 10 ", "vertex 10,00 ").replace("\nv 10 ", "\nv 10,00 ").replace("\n10 ", "\n10,00 ")
    )
    assert text.count(",") > 2
    (tmp_path / f"skin.{ending}").write_text(text, encoding="utf-8")
    assert_same_triangles(read_surface(tmp_path / f"skin.{ending}"))


def glb(scene: dict) -> bytes:
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    return b"glTF" + struct.pack("<III", 2, 20 + len(text), len(text)) + b"JSON" + text


FRIENDLY_OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.obj", b"mtllib secret.txt\nusemtl a\n" + FRIENDLY_OBJ.encode()),
        (
            "a.ply",
            b"ply\nformat ascii 1.0\ncomment TextureFile secret.txt\nelement vertex 3\nproperty float x\n"
            b"property float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\n"
            b"end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        ),
        ("a.glb", glb({"asset": {"version": "2.0"}, "buffers": [{"byteLength": 9, "uri": "secret.txt"}]})),
        (
            "b.glb",
            glb({"asset": {"version": "2.0"}, "buffers": [{"byteLength": 9, "uri": "http://127.0.0.1:9/"}]}),
        ),
        ("c.glb", glb({"asset": {"version": "2.0"}, "images": [{"uri": "secret.txt"}]})),
        (
            "a.vtp",
            b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b SYSTEM "secret.txt">]>'
            b'<VTKFile type="PolyData"><PolyData>&b;</PolyData></VTKFile>',
        ),
    ],
)
def test_no_file_is_opened_but_the_surface(tmp_path, name, content):
    (tmp_path / "secret.txt").write_text("newmtl a\nKd 1 1 1\n", encoding="utf-8")
    (tmp_path / name).write_bytes(content)
    refused = None
    with audited() as events:
        try:
            read_surface(tmp_path / name)
        except InputError as error:
            refused = str(error)
    assert {event for event, _ in events} == {"open"}
    assert {Path(path).name for _, path in events} == {name}
    assert (refused is None) == (name in ("a.obj", "a.ply"))


def states(space: str) -> dict[str, bytes]:
    """The pyramid as 3D Slicer writes it in these axes, which the header states, by ending."""
    points = [f"{x:g} {y:g} {z:g}" for x, y, z in PYRAMID.vertices * ([-1, -1, 1] if space == "RAS" else 1)]
    corners = [" ".join(map(str, face)) for face in PYRAMID.faces]
    from_one = [" ".join(map(str, face + 1)) for face in PYRAMID.faces]
    said = f"3D Slicer output. SPACE={space}"
    facets = np.zeros(6, dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    facets["corners"] = [[points[c].split() for c in face] for face in PYRAMID.faces]
    loops = ["\n".join(f"vertex {points[c]}" for c in face) for face in PYRAMID.faces]
    vtk = f"DATASET POLYDATA\nPOINTS 5 float\n{' '.join(points)}\nPOLYGONS 6 24\n3 " + "\n3 ".join(corners)
    texts = {
        "ply": f"ply\nformat ascii 1.0\ncomment {said}\nelement vertex 5\nproperty float x\nproperty float y\n"
        "property float z\nelement face 6\nproperty list uchar int vertex_indices\nend_header\n"
        + "\n".join([*points, *(f"3 {c}" for c in corners)]),
        "obj": f"# {said}\nv " + "\nv ".join(points) + "\nf " + "\nf ".join(from_one),
        "text.stl": f"solid a; {said}\n"
        + "".join(f"facet normal 0 0 1\nouter loop\n{loop}\nendloop\nendfacet\n" for loop in loops)
        + "endsolid a\n",
        "title.vtk": f"# vtk DataFile Version 3.0\n{said}\nASCII\n" + vtk,
    }  # fmt: skip
    stl = f"a; {said}".encode().ljust(80) + struct.pack("<I", 6) + facets.tobytes()
    return {name: text.encode() for name, text in texts.items()} | {"stl": stl}


@pytest.mark.parametrize("space", ["RAS", "LPS"])
def test_the_axes_that_a_header_states_are_converted(tmp_path, space):
    for name, content in states(space).items():
        path = tmp_path / f"a.{name}"
        path.write_bytes(content)
        assert_same_triangles(read_surface(path))


VARIANTS = ["SPACE=RAS", "SPACE = RAS", "space=ras", "Coordinate SPACE=RAS; 5.6", "SPACE=RIGHT-ANTERIOR-SUPERIOR"]


@pytest.mark.parametrize("name", ["ply", "obj", "title.vtk", "stl"])
def test_forms_of_a_stated_space(name, tmp_path):
    """As versions of 3D Slicer and people write it; lines end as on each system."""
    path = tmp_path / f"a.{name}"
    for text, ends in product(VARIANTS, ("\n", "\r\n")):
        content = states("RAS")[name]
        if name == "stl":
            content = f"a; {text}".encode().ljust(80) + content[80:]
        else:
            content = content.replace(b"3D Slicer output. SPACE=RAS", text.encode()).replace(b"\n", ends.encode())
        path.write_bytes(content)
        assert_same_triangles(read_surface(path))


@pytest.mark.parametrize("ending", ["ply", "stl", "obj", "off"])
def test_written_surfaces_state_their_axes(tmp_path, ending):
    for space in ("LPS", "RAS", None):
        write_surface(tmp_path / f"a.{ending}", PYRAMID, space)
        assert read_stated(tmp_path / f"a.{ending}")[1] == space


def test_what_vtk_writes_with_a_space_is_read(tmp_path):
    vtk = pytest.importorskip("vtk")
    source = vtk.vtkCubeSource()
    source.SetCenter(10.0, 20.0, 30.0)
    source.Update()
    data, space = source.GetOutput(), vtk.vtkStringArray()
    space.SetName("SPACE")
    space.InsertNextValue("RAS")
    data.GetFieldData().AddArray(space)
    for version, binary in ((42, 0), (42, 1), (51, 0), (51, 1)):
        writer = vtk.vtkPolyDataWriter()
        writer.SetFileVersion(version)
        writer.SetFileType(2 if binary else 1)
        written(writer, tmp_path / f"{version}{binary}.vtk", data)
    for mode in ("Ascii", "Binary", "Appended"):
        writer = vtk.vtkXMLPolyDataWriter()
        getattr(writer, f"SetDataModeTo{mode}")()
        written(writer, tmp_path / f"{mode}.vtp", data)
    for path in sorted(tmp_path.iterdir()):
        back = read_surface(path).vertices
        np.testing.assert_allclose(back.mean(axis=0), [-10.0, -20.0, 30.0], err_msg=path.name)


def written(writer, path: Path, data) -> None:
    writer.SetFileName(str(path))
    writer.SetInputData(data)
    assert writer.Write()


@pytest.mark.parametrize("ending", ["ply", "obj", "off"])
def test_vertices_doubled_along_a_seam_are_one(tmp_path, ending):
    """As meshes with a texture atlas come: closed to look at, open by its numbers; two touching boxes stay two."""
    faces = PYRAMID.faces.copy()
    faces[:2][faces[:2] == 4] = 5
    write_surface(tmp_path / f"a.{ending}", Surface(np.vstack([PYRAMID.vertices, PYRAMID.vertices[4]]), faces))
    assert_same(read_surface(tmp_path / f"a.{ending}"), PYRAMID, 1e-5)
    twice = Surface(np.vstack([PYRAMID.vertices] * 2), np.vstack([PYRAMID.faces, PYRAMID.faces + 5]))
    write_surface(tmp_path / f"b.{ending}", twice)
    assert len(read_surface(tmp_path / f"b.{ending}").vertices) == 10


def of_nodes(mesh, **nodes):
    scene = trimesh.Scene()
    for name, matrix in nodes.items():
        scene.add_geometry(mesh, node_name=name, transform=matrix)
    return scene


def colours_of_box():
    return np.array(
        [[250, 0, 0, 255], [0, 250, 0, 255], [0, 0, 250, 255], [9, 9, 9, 255], [90, 90, 90, 255]], "u1"
    )


@pytest.mark.parametrize("coloured", [False, True])
def test_a_glb_is_read_the_same_way_with_colours_and_without(tmp_path, coloured):
    """A node that mirrors turns the triangles; lines and points beside the surface are passed over."""
    mesh = trimesh.Trimesh(PYRAMID.vertices, PYRAMID.faces, process=False)
    if coloured:
        mesh.visual = ColorVisuals(mesh, vertex_colors=colours_of_box())
    scene = of_nodes(mesh, mirrored=np.diag([-1.0, 1.0, 1.0, 1.0]))
    scene.add_geometry(trimesh.load_path(np.array([[0.0, 0, 0], [50, 0, 0], [50, 50, 0]])))
    scene.add_geometry(trimesh.PointCloud(np.array([[0.0, 0, 90], [1, 0, 90]])))
    scene.export(tmp_path / "a.glb")
    back = read_surface(tmp_path / "a.glb")
    expected = trimesh.Trimesh(PYRAMID.vertices * [-1, 1, 1], PYRAMID.faces[:, ::-1], process=False)
    np.testing.assert_allclose(np.sort(back.vertices, axis=0), np.sort(expected.vertices, axis=0), atol=1e-5)
    volume = (
        np.einsum(
            "fx,fx->",
            back.vertices[back.faces[:, 0]],
            np.cross(back.vertices[back.faces[:, 1]], back.vertices[back.faces[:, 2]]),
        )
        / 6.0
    )
    assert volume == pytest.approx(expected.volume)
    assert (back.colours is not None) == coloured


def test_a_glb_in_metres_as_gltf_has_them_is_read_in_mm(tmp_path):
    of_nodes(trimesh.Trimesh(PYRAMID.vertices / 1000.0, PYRAMID.faces), a=np.eye(4)).export(tmp_path / "a.glb")
    extent = np.ptp(read_surface(tmp_path / "a.glb").vertices, axis=0)
    np.testing.assert_allclose(extent, [10, 10, 10.1], atol=1e-4)
    for size in (1.0, 10.0, 25.4, 1000.0):  # the unit of files that state none
        said = read_stated(tmp_path / "a.glb", size)[0].vertices
        np.testing.assert_allclose(size * np.ptp(said, axis=0), [10, 10, 10.1], atol=1e-4)
        points = read_points(tmp_path / "a.glb", size)
        np.testing.assert_allclose(np.ptp(points, axis=0), [10, 10, 10.1], atol=1e-4)


@pytest.mark.parametrize(
    ("extension", "said"),
    [
        ("KHR_materials_unlit", None),
        ("KHR_texture_transform", None),
        ("KHR_draco_mesh_compression", "it needs KHR_draco"),
    ],
)
def test_an_extension_of_colours_decides_nothing(tmp_path, extension, said):
    write_surface(tmp_path / "a.glb", PYRAMID)
    content = (tmp_path / "a.glb").read_bytes()
    length = struct.unpack_from("<I", content, 12)[0]
    scene = json.loads(content[20 : 20 + length]) | {"extensionsRequired": [extension]}
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I", len(text)) + b"JSON" + text + content[20 + length :]
    (tmp_path / "a.glb").write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks)
    if said is None:
        assert len(read_surface(tmp_path / "a.glb").faces) == 6
    else:
        with pytest.raises(InputError, match=said):
            read_surface(tmp_path / "a.glb")


ODD_OBJ = [
    "\ufeff" + FRIENDLY_OBJ,
    "mtllib\n" + FRIENDLY_OBJ,
    "mtllib a.mtl\nvt 0 0\n" + FRIENDLY_OBJ.replace("f 1 3 2", "f 1/1 3/1 2/1"),
    "usemtl a\nvt 0 -nan(ind)\nvn x 1.#QNAN 0\n" + FRIENDLY_OBJ.replace("f 1 3 2", "f 1/9/7 3/x/0 2/-5/1"),
    FRIENDLY_OBJ.replace("f 1 3 2", "v nan nan nan\nv 9e9 0 0\nf 1 3 2"),
]


@pytest.mark.parametrize("text", ODD_OBJ)
def test_what_an_obj_does_not_need_decides_nothing(tmp_path, text):
    """A mark before it, textures without a material, their places, normals, vertices in no triangle."""
    (tmp_path / "a.obj").write_text(text, encoding="utf-8")
    (tmp_path / "a.mtl").write_text("newmtl a\nKd 0.5 0.5 0.5\n", encoding="utf-8")
    surface = read_surface(tmp_path / "a.obj")
    np.testing.assert_array_equal(surface.vertices[surface.faces], [
        [[0, 0, 0], [0, 1, 0], [1, 0, 0]], [[0, 0, 0], [1, 0, 0], [0, 0, 1]],
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 0, 0], [0, 0, 1], [0, 1, 0]],
    ])  # fmt: skip


@pytest.mark.parametrize("none", ["-nan(ind)", "1.#QNAN", "nan", "-1.#IND"])
def test_normals_that_are_no_numbers_decide_nothing(tmp_path, none):
    head = "ply\nformat ascii 1.0\nelement vertex 4\n"
    head += "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx"))
    faces = "3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
    body = f"0 0 0 1\n1 0 0 {none}\n0 1 0 1\n0 0 1 {none}\n{faces}"
    head += "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(head + body, encoding="utf-8")
    assert len(read_surface(tmp_path / "a.ply").faces) == 4
    (tmp_path / "a.ply").write_text(head + body.replace("1 0 0 ", f"{none} 0 0 "), encoding="utf-8")
    with pytest.raises(InputError, match="1 of 4 vertices are not finite"):
        read_surface(tmp_path / "a.ply")


def test_unnamed_columns_in_the_metadata_of_vtk_are_read(tmp_path):
    """As VTK writes names of the columns of which one is empty."""
    vtk = pytest.importorskip("vtk")
    numpy_to_vtk = pytest.importorskip("vtk.util.numpy_support").numpy_to_vtk

    data, points, cells = vtk.vtkPolyData(), vtk.vtkPoints(), vtk.vtkCellArray()
    array = numpy_to_vtk(PYRAMID.vertices, deep=True)
    array.SetComponentName(0, "left")
    array.SetComponentName(2, "up")
    array.GetRange(-1)
    points.SetData(array)
    for face in PYRAMID.faces.tolist():
        cells.InsertNextCell(3, face)
    data.SetPoints(points)
    data.SetPolys(cells)
    writer = vtk.vtkPolyDataWriter()
    writer.SetFileName(str(tmp_path / "a.vtk"))
    writer.SetInputData(data)
    assert writer.Write()
    assert b"COMPONENT_NAMES" in (tmp_path / "a.vtk").read_bytes()
    assert_same(read_surface(tmp_path / "a.vtk"), PYRAMID, 1e-6)


REFUSED = {
    "a.usdz": b"PK\x03\x04", "a.ply.gz": b"\x1f\x8b\x08", "a.ply": b"\x1f\x8b\x08", "a.obj": b"PK\x03\x04",
    "b.obj": states("RAS")["obj"].replace(b"SPACE=RAS", b"SPACE=ASR"),
}  # fmt: skip


def test_lines_of_packed_files_other_axes_and_formats_of_phones_are_as_accepted(tmp_path):
    lines = []
    for name, content in REFUSED.items():
        (tmp_path / name).write_bytes(content)
        lines.append(refusal(name, tmp_path, lambda name=name: read_surface(tmp_path / name)))
    check_shown("refused_surfaces", lines)
