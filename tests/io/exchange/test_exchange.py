"""Meshes for other programs, and from them."""

from xml.etree import ElementTree

import meshio
import numpy as np
import pytest

from support.small_trunk import boned_case, small_trunk
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh, tet_volumes
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.exchange import read_volume, write_volume

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


@pytest.mark.parametrize("ending", [".vtu", ".vtk", ".xdmf", ".msh", ".inp"])
def test_a_mesh_comes_back_through_every_format(ending, trunk, motion, bones, tmp_path):
    write_volume(tmp_path / f"a{ending}", trunk, motion, TISSUE)
    back = read_volume(tmp_path / f"a{ending}", skin_of(trunk), bones)
    np.testing.assert_allclose(back.nodes, trunk.nodes, atol=1e-9)
    np.testing.assert_array_equal(back.tets, trunk.tets)
    np.testing.assert_array_equal(back.bone, trunk.bone)
    assert set(back.skin_nodes) == set(trunk.skin_nodes)
    as_set = {frozenset(face) for face in trunk.skin_nodes[trunk.skin_faces].tolist()}
    assert {frozenset(face) for face in back.skin_nodes[back.skin_faces].tolist()} == as_set


def test_abaqus_gets_sets_material_and_every_displacement(trunk, motion, tmp_path):
    write_volume(tmp_path / "a.inp", trunk, motion, TISSUE)
    sets = meshio.read(tmp_path / "a.inp").point_sets
    np.testing.assert_array_equal(np.sort(sets["skin"]), np.sort(trunk.skin_nodes))
    np.testing.assert_array_equal(sets["bone_T10"], np.flatnonzero(trunk.bone == 0))
    text = (tmp_path / "a.inp").read_text()
    assert "*ELASTIC\n0.012, 0.4\n" in text  # MPa
    rows = [row.split(",") for row in text.split("*BOUNDARY\n")[1].split("*NODE FILE")[0].splitlines()]
    held = {(int(node) - 1, int(axis) - 1): float(u) for node, axis, _, u in rows}
    assert len(held) == 3 * trunk.prescribed.sum()
    assert all(
        trunk.prescribed[node] and u == pytest.approx(motion[node, axis]) for (node, axis), u in held.items()
    )


def words(element: ElementTree.Element | None) -> list[str]:
    """The words of an element, parted by commas."""
    assert element is not None
    assert element.text is not None
    return element.text.split(",")


def test_febio_gets_a_whole_problem(trunk, motion, tmp_path):
    write_volume(tmp_path / "a.feb", trunk, motion, TISSUE)
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
    assert [words(root.find(f"Material/material/{name}")) for name in ("density", "E", "v")] == [
        ["9.5e-10"],
        ["0.012"],
        ["0.4"],
    ]


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


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        ({"nodes": lambda t: t.nodes / 1000.0}, "from the skin of the case"),
        ({"nodes": lambda t: t.nodes + np.array([0.0, 30.0, 0.0])}, "from the skin of the case"),
        ({"data": lambda t: {}}, "does not mark the nodes on bone"),
        ({"data": lambda t: {"bone": np.full(len(t.nodes), -1)}}, "no node lies on bone"),
        ({"cells": lambda t: [("triangle", t.tets[:, :3])]}, "not no solid cells"),
        ({"cells": lambda t: [("tetra", t.tets), ("wedge", t.tets[:2, [0, 1, 2, 3, 0, 1]])]}, "not tetra, wedge"),
        ({"data": lambda t: {"bone": np.where(t.nodes[:, 2] > 400, 0, -1)}}, "bone"),
    ],
)
def test_meshes_that_do_not_fit_are_refused(change, rule, trunk, bones, tmp_path):
    foreign(tmp_path / "a.vtu", trunk, **{name: make(trunk) for name, make in change.items()})
    with pytest.raises(InputError) as error:
        read_volume(tmp_path / "a.vtu", skin_of(trunk), bones)
    assert "a.vtu" in str(error.value)
    assert rule in str(error.value)
