"""Meshes for other programs, and from them."""

import re
from dataclasses import replace
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest

from support.asserting import not_none
from support.refusals import refusal
from support.shown import check_shown
from support.small_trunk import boned_case, small_trunk
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh, tet_volumes
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files.space import stated_space
from warp_trunk.io.volume_files import read_mesh
from warp_trunk.io.volume_reader import read_volume
from warp_trunk.io.volume_writer import write_volume

TISSUE = Tissue(youngs_modulus=12.0, poisson_ratio=0.4, density=950.0)


@pytest.fixture(scope="module")
def trunk() -> TrunkMesh:
    return small_trunk()[0]


@pytest.fixture(scope="module")
def motion(trunk):
    return np.random.default_rng(5).normal(size=trunk.nodes.shape)


@pytest.fixture(scope="module")
def bones():
    """A thin box through the nodes on bone."""
    return boned_case()[0].bones


def skin_of(trunk):
    return Surface(trunk.nodes[trunk.skin_nodes], trunk.skin_faces)


def jointed(trunk):
    """The same with three layers and a joint: a fifth of the nodes on bone is free."""
    shares = np.random.default_rng(2).dirichlet(np.ones(3), len(trunk.tets))
    low = np.quantile(trunk.nodes[trunk.prescribed, 2], 0.2)
    return replace(trunk, bone=np.where(trunk.nodes[:, 2] <= low, -1, trunk.bone).astype(np.int32), tissue=shares)


LAYERS = tuple(Tissue(youngs_modulus=modulus, poisson_ratio=0.3) for modulus in (130.0, 2.5, 10.0))


def moduli_of_abaqus(path):
    """Young's modulus [kPa] of each tetrahedron of an .inp file, by its sections and materials."""
    words = path.read_text(encoding="utf-8").upper()
    material = dict(re.findall(r"\*MATERIAL, NAME=(\S+)\n\*ELASTIC\n([^,]+),", words))
    section = dict(re.findall(r"\*SOLID SECTION, ELSET=(\S+?), MATERIAL=(\S+)", words))
    sets = {name.upper(): np.concatenate(blocks) for name, blocks in meshio.read(path).cell_sets.items()}
    return {name: (1e3 * float(material[section[name]]), sets[name]) for name in section}


def moduli_of_febio(path):
    """The same of a .feb file."""
    root = ElementTree.parse(path).getroot()
    material = {node.get("name"): 1e3 * float(not_none(node.findtext("E"))) for node in root.iter("material")}
    domain = {node.get("name"): node.get("mat") for node in root.iter("SolidDomain")}
    return {
        node.get("name"): (
            material[domain[node.get("name")]],
            np.array([int(not_none(row.get("id"))) for row in node.iter("elem")]) - 1,
        )
        for node in root.iter("Elements")
    }


@pytest.mark.parametrize(("ending", "read"), [(".inp", moduli_of_abaqus), (".feb", moduli_of_febio)])
def test_each_layer_has_its_own_material_for_solvers(ending, read, trunk, motion, tmp_path):
    mesh, path = jointed(trunk), tmp_path / f"a{ending}"
    write_volume(path, mesh, motion, LAYERS, ("skin", "fat", "muscle"))
    moduli = np.full(len(mesh.tets), np.nan)
    for modulus, tets in read(path).values():
        assert np.isnan(moduli[tets]).all()
        moduli[tets] = modulus
    wanted = np.array([layer.youngs_modulus for layer in LAYERS])[mesh.tissue.argmax(axis=1)]
    np.testing.assert_allclose(moduli, wanted)
    with pytest.raises(InputError, match="the mesh has 3 tissues, not 1"):
        write_volume(path, mesh, motion, TISSUE)


def sets_of(trunk):
    """The skin's nodes and triangles, whatever their order."""
    return set(trunk.skin_nodes), {frozenset(face) for face in trunk.skin_nodes[trunk.skin_faces].tolist()}


@pytest.mark.parametrize("ending", [".vtu", ".vtk", ".xdmf", ".msh", ".inp"])
def test_a_mesh_comes_back_through_every_format_in_the_axes_that_it_states(ending, trunk, motion, bones, tmp_path):
    """Also with layers and a free joint, which is no skin."""
    path = tmp_path / f"a{ending}"
    for mesh in (trunk, jointed(trunk)):
        write_volume(path, mesh, motion, TISSUE if mesh.tissue is None else (TISSUE, *LAYERS[1:]))
        back = read_volume(path, skin_of(trunk), bones)
        np.testing.assert_allclose(back.nodes, trunk.nodes, atol=1e-9)
        np.testing.assert_array_equal(back.tets, trunk.tets)
        np.testing.assert_array_equal(back.bone, mesh.bone)
        assert sets_of(back) == sets_of(trunk)
    if ending not in (".msh", ".inp"):
        np.testing.assert_allclose(not_none(back.tissue), not_none(mesh.tissue))
    elif ending == ".msh":
        np.testing.assert_array_equal(not_none(back.tissue), not_none(mesh.tissue).argmax(axis=1))
    content = path.read_bytes()
    assert stated_space(ending, content) == "LPS"
    codes = [" ".join(map(str, name.encode())).encode() for name in ("LPS", "RAS")]
    path.write_bytes(content.replace(b"LPS", b"RAS").replace(*codes))
    np.testing.assert_allclose(read_mesh(path).points, trunk.nodes * [-1.0, -1.0, 1.0], atol=1e-9)


def by_meshio(path):
    mesh = meshio.read(path)
    part = np.concatenate(mesh.cell_data["part"])
    return mesh.points, mesh.point_data, part, mesh.field_data


def by_vtk(path):
    vtk = pytest.importorskip("vtk")
    numpy_of = pytest.importorskip("vtk.util.numpy_support").vtk_to_numpy
    reader = vtk.vtkUnstructuredGridReader() if path.suffix == ".vtk" else vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()  # ParaView's readers
    grid = reader.GetOutput()
    data, fields = (
        {array.GetName(): numpy_of(array) for array in map(of.GetArray, range(of.GetNumberOfArrays()))}
        for of in (grid.GetPointData(), grid.GetFieldData())
    )
    return numpy_of(grid.GetPoints().GetData()), data, numpy_of(grid.GetCellData().GetArray("part")), fields


def by_pyvista(path):
    mesh = pytest.importorskip("pyvista").read(path)
    return mesh.points, mesh.point_data, mesh.cell_data["part"], mesh.field_data


@pytest.mark.parametrize("ending", [".vtk", ".vtu"])
@pytest.mark.parametrize("read", [by_meshio, by_vtk, by_pyvista])
def test_every_reader_of_vtk_files_finds_arrays_and_names_of_bones(read, ending, trunk, motion, tmp_path):
    """Names with letters of two bytes, too."""
    trunk = replace(jointed(trunk), bone_names=("T10", "c\u00f4te gauche"))
    write_volume(tmp_path / f"a{ending}", trunk, motion, TISSUE)
    points, data, part, fields = read(tmp_path / f"a{ending}")
    np.testing.assert_allclose(points, trunk.nodes)
    np.testing.assert_allclose(data["displacement"], motion)
    np.testing.assert_array_equal(data["bone"], trunk.bone)
    assert set(data["node_kind"]) == {0, 1, 2}
    counts = [len(trunk.tets), len(trunk.skin_faces), len(trunk.bone_faces)]
    np.testing.assert_array_equal(np.bincount(part), counts)
    names = np.asarray(fields["bone_names"]).astype(np.uint8).tobytes().decode()
    assert tuple(names.split("\n")) == trunk.bone_names


@pytest.mark.parametrize("read", [by_meshio, by_vtk, by_pyvista])
def test_axes_are_stated_where_no_reader_stumbles(read, trunk, motion, tmp_path):
    write_volume(tmp_path / "a.vtu", trunk, motion, TISSUE)
    assert np.asarray(read(tmp_path / "a.vtu")[3]["SPACE"]).astype(np.uint8).tobytes() == b"LPS"
    write_volume(tmp_path / "a.vtk", trunk, motion, TISSUE)
    assert b"SPACE=LPS" in (tmp_path / "a.vtk").read_bytes().splitlines()[1]  # the title, where Slicer looks


@pytest.mark.parametrize("ending", [".xdmf", ".msh", ".inp"])
def test_meshio_reads_the_other_formats(ending, trunk, motion, tmp_path):
    write_volume(tmp_path / f"a{ending}", trunk, motion, TISSUE)
    mesh = meshio.read(tmp_path / f"a{ending}")
    np.testing.assert_allclose(mesh.points, trunk.nodes, rtol=1e-10)
    np.testing.assert_array_equal(mesh.cells_dict["tetra"], trunk.tets)


@pytest.mark.parametrize("ending", [".vtu", ".vtk"])
def test_a_mesh_that_meshio_saved_again_is_read(ending, trunk, motion, bones, tmp_path):
    """It leaves out the names of the bones."""
    write_volume(tmp_path / "a.vtu", trunk, motion, TISSUE)
    meshio.write(tmp_path / f"b{ending}", meshio.read(tmp_path / "a.vtu"))
    back = read_volume(tmp_path / f"b{ending}", skin_of(trunk), bones)
    np.testing.assert_array_equal(back.bone, trunk.bone)
    assert sets_of(back) == sets_of(trunk)


def test_gmsh_reads_groups_of_layers_skin_and_bones(trunk, motion, tmp_path):
    gmsh = pytest.importorskip("gmsh")
    write_volume(tmp_path / "a.msh", jointed(trunk), motion, TISSUE, ("skin", "fat", "muscle"))
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tmp_path / "a.msh"))
        groups = {}
        for dimension, tag in gmsh.model.getPhysicalGroups():
            entities = gmsh.model.getEntitiesForPhysicalGroup(dimension, tag)
            parts = [gmsh.model.mesh.getElements(dimension, entity)[1] for entity in entities]
            groups[gmsh.model.getPhysicalName(dimension, tag)] = sum(len(tags) for part in parts for tags in part)
        views = {gmsh.view.option.getString(tag, "Name") for tag in gmsh.view.getTags()}
    finally:
        gmsh.finalize()
    layers = np.bincount(jointed(trunk).tissue.argmax(axis=1))
    expected = {f"tissue_{name}": layers[n] for n, name in enumerate(("skin", "fat", "muscle"))}
    assert groups == expected | {"skin": len(trunk.skin_faces), "bone_T10": len(trunk.bone_faces)}
    assert {"displacement", "bone", "node_kind"} <= views


def test_groups_of_gmsh_mark_bones(trunk, bones, tmp_path):
    """As a mesh made in Gmsh comes: groups alone, no point data."""
    triangles = np.concatenate([trunk.skin_nodes[trunk.skin_faces], trunk.bone_faces])
    group = np.where(np.arange(len(triangles)) < len(trunk.skin_faces), 1, 2)
    groups = [np.full(len(trunk.tets), 3), group]
    mesh = meshio.Mesh(
        trunk.nodes,
        [("tetra", trunk.tets), ("triangle", triangles)],
        cell_data={"gmsh:physical": groups, "gmsh:geometrical": groups},
        field_data={"skin": np.array([1, 2]), "Bones": np.array([2, 2]), "tissue": np.array([3, 3])},
    )
    meshio.gmsh.write(str(tmp_path / "a.msh"), mesh, fmt_version="2.2")
    back = read_volume(tmp_path / "a.msh", skin_of(trunk), bones)
    np.testing.assert_array_equal(back.prescribed, np.isin(np.arange(len(trunk.nodes)), trunk.bone_faces))


LEGACY = [(".vtk", {"FileVersion": version, "FileType": kind}) for version in (42, 51) for kind in (1, 2)]
XML = [(".vtu", {"DataMode": mode, "EncodeAppendedData": code}) for mode, code in ((0, 1), (1, 1), (2, 1), (2, 0))]


@pytest.mark.parametrize(("ending", "settings"), LEGACY + XML)
def test_grids_that_vtk_and_slicer_write_are_read(ending, settings, trunk, bones, tmp_path):
    """Field data, strings, METADATA behind arrays, and SPACE=RAS, by VTK's own writers."""
    vtk = pytest.importorskip("vtk")
    ours = pytest.importorskip("vtk.util.numpy_support").numpy_to_vtk
    grid, points = vtk.vtkUnstructuredGrid(), vtk.vtkPoints()
    points.SetData(ours(trunk.nodes * [-1.0, -1.0, 1.0], deep=True))
    grid.SetPoints(points)
    for tet in trunk.tets.tolist():
        grid.InsertNextCell(vtk.VTK_TETRA, 4, tet)
    bone = ours(trunk.bone, deep=True)
    bone.SetName("bone")
    bone.GetRange(-1)  # makes the writer add METADATA
    grid.GetPointData().AddArray(bone)
    time, space = vtk.vtkDoubleArray(), vtk.vtkStringArray()
    for array, name, value in ((time, "TimeValue", 0.5), (space, "SPACE", "RAS")):
        array.SetName(name)
        array.InsertNextValue(value)
        grid.GetFieldData().AddArray(array)
    writer = vtk.vtkUnstructuredGridWriter() if ending == ".vtk" else vtk.vtkXMLUnstructuredGridWriter()
    for name, value in settings.items():
        getattr(writer, f"Set{name}")(value)
    writer.SetFileName(str(tmp_path / f"a{ending}"))
    writer.SetInputData(grid)
    assert writer.Write()
    back = read_volume(tmp_path / f"a{ending}", skin_of(trunk), bones)
    np.testing.assert_allclose(back.nodes, trunk.nodes, atol=1e-4)
    np.testing.assert_array_equal(back.bone, trunk.bone)


def test_abaqus_gets_sets_material_and_every_displacement(trunk, motion, tmp_path):
    write_volume(tmp_path / "a.inp", trunk, motion, TISSUE)
    sets = meshio.read(tmp_path / "a.inp").point_sets
    np.testing.assert_array_equal(np.sort(sets["skin"]), np.sort(trunk.skin_nodes))
    np.testing.assert_array_equal(sets["bone_T10"], np.flatnonzero(trunk.bone == 0))
    text = (tmp_path / "a.inp").read_text(encoding="utf-8")
    assert "*ELASTIC\n0.012, 0.4\n" in text  # MPa
    rows = [row.split(",") for row in text.split("*BOUNDARY\n")[1].split("*NODE FILE")[0].splitlines()]
    held = {(int(node) - 1, int(axis) - 1): float(u) for node, axis, _, u in rows}
    assert len(held) == 3 * trunk.prescribed.sum()
    assert all(
        trunk.prescribed[node] and u == pytest.approx(motion[node, axis]) for (node, axis), u in held.items()
    )


def words(element: ElementTree.Element | None) -> list[str]:
    """The words of an element, parted by commas."""
    return not_none(not_none(element).text).split(",")


def test_febio_gets_a_whole_problem(trunk, motion, tmp_path):
    write_volume(tmp_path / "a.feb", trunk, motion, TISSUE)
    assert stated_space(".feb", (tmp_path / "a.feb").read_bytes()) == "LPS"
    root = ElementTree.parse(tmp_path / "a.feb").getroot()
    nodes = [list(map(float, words(node))) for node in root.iterfind("Mesh/Nodes/node")]
    np.testing.assert_allclose(nodes, trunk.nodes, rtol=1e-11, atol=1e-9)
    tets = [list(map(int, words(elem))) for elem in root.iterfind("Mesh/Elements/elem")]
    np.testing.assert_array_equal(np.array(tets) - 1, trunk.tets)
    on_bone = np.array(words(root.find("Mesh/NodeSet[@name='bones']")), dtype=int) - 1
    np.testing.assert_array_equal(on_bone, np.flatnonzero(trunk.prescribed))
    for axis, name in enumerate("xyz"):
        told = [float(*words(node)) for node in root.iterfind(f"MeshData/NodeData[@name='bones_{name}']/node")]
        np.testing.assert_allclose(told, motion[on_bone, axis], rtol=1e-11)
    material = [words(root.find(f"Material/material/{name}")) for name in ("density", "E", "v")]
    assert material == [["9.5e-10"], ["0.012"], ["0.4"]]


def test_a_mesh_of_another_program_is_turned_and_cleared_of_loose_nodes(trunk, bones, tmp_path):
    """Negative tetrahedra, a node of no tetrahedron, tags of bone only, and labels of tissue."""
    points = np.concatenate([[[1e3, 0, 0]], trunk.nodes])
    tets = trunk.tets[:, [1, 0, 2, 3]] + 1
    kind = np.concatenate([[0], np.where(trunk.prescribed, 2, 0)])
    label = np.arange(len(tets)) % 3
    mesh = meshio.Mesh(points, [("tetra", tets)], point_data={"node_kind": kind}, cell_data={"tissue": [label]})
    meshio.write(tmp_path / "a.vtu", mesh)
    back = read_volume(tmp_path / "a.vtu", skin_of(trunk), bones)
    np.testing.assert_allclose(tet_volumes(back.nodes, back.tets), tet_volumes(trunk.nodes, trunk.tets))
    np.testing.assert_array_equal(back.prescribed, trunk.prescribed)
    np.testing.assert_array_equal(back.tissue, label)


def foreign(path, trunk, **change):
    parts = {"nodes": trunk.nodes, "cells": [("tetra", trunk.tets)], "data": {"bone": trunk.bone}} | change
    meshio.write(path, meshio.Mesh(parts["nodes"], parts["cells"], point_data=parts["data"]))


FOREIGN = {
    "in metres": {"nodes": lambda t: t.nodes / 1000.0},
    "beside the skin": {"nodes": lambda t: t.nodes + np.array([0.0, 30.0, 0.0])},
    "without data": {"data": lambda t: {}},
    "without bone": {"data": lambda t: {"bone": np.full(len(t.nodes), -1)}},
    "zeros": {"data": lambda t: {"bone": np.zeros(len(t.nodes))}},
    "all bone": {"data": lambda t: {"bone": np.ones(len(t.nodes))}},
    "triangles": {"cells": lambda t: [("triangle", t.tets[:, :3])]},
    "doubled": {"cells": lambda t: [("tetra", np.repeat(t.tets, 2, axis=0))]},
    "wedges": {"cells": lambda t: [("tetra", t.tets), ("wedge", t.tets[:2, [0, 1, 2, 3, 0, 1]])]},
    "bone far from bones": {"data": lambda t: {"bone": np.where(t.nodes[:, 2] > 400, 0, -1)}},
}


def two_pieces(content):
    start, tag, rest = content.partition("<Piece")
    piece, closing, end = (tag + rest).partition("</Piece>")
    return start + 2 * (piece + closing) + end


DAMAGED = {
    "other elements": (".inp", lambda text: text.replace("C3D4", "C3D5")),
    "packed otherwise": (".vtu", lambda text: text.replace("ZLib", "LZ4")),
    "two pieces": (".vtu", two_pieces),
}


def test_lines_of_meshes_that_do_not_fit_are_as_accepted(trunk, motion, bones, tmp_path):
    lines, path = [], tmp_path / "a.vtu"
    for name, change in FOREIGN.items():
        foreign(path, trunk, **{key: make(trunk) for key, make in change.items()})
        lines.append(refusal(name, tmp_path, lambda: read_volume(path, skin_of(trunk), bones)))
    for name, (ending, damage) in DAMAGED.items():
        path = tmp_path / f"a{ending}"
        write_volume(path, trunk, motion, TISSUE)
        path.write_text(damage(path.read_text(encoding="utf-8")), encoding="utf-8")
        lines.append(refusal(name, tmp_path, lambda path=path: read_volume(path, skin_of(trunk), bones)))
    check_shown("refused_meshes", lines)


@pytest.mark.parametrize("none", [0, -1, np.nan])
def test_marks_of_bone_are_0_and_1_or_numbers_of_bones(none, trunk, bones, tmp_path):
    marks = np.where(trunk.prescribed, 1.0 if none == 0 else 0.0, none)
    foreign(tmp_path / "a.vtu", trunk, data={"bone": marks})
    back = read_volume(tmp_path / "a.vtu", skin_of(trunk), bones)
    np.testing.assert_array_equal(back.prescribed, trunk.prescribed)


def test_hybrid_tetrahedra_of_abaqus_are_tetrahedra(trunk, motion, bones, tmp_path):
    write_volume(tmp_path / "a.inp", trunk, motion, TISSUE)
    (tmp_path / "a.inp").write_text(
        (tmp_path / "a.inp").read_text(encoding="utf-8").replace("C3D4", "C3D4H"), encoding="utf-8"
    )
    np.testing.assert_array_equal(read_volume(tmp_path / "a.inp", skin_of(trunk), bones).tets, trunk.tets)
