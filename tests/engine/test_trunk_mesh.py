from dataclasses import fields, replace

import meshio
import numpy as np
import pytest

from support.synthetic import shell_trunk
from warp_trunk.engine.trunk_mesh import check_trunk, tet_volumes
from warp_trunk.errors import InputError
from warp_trunk.io.trunk_file import read_trunk, write_trunk


@pytest.fixture(scope="module")
def trunk():
    return shell_trunk()


def test_vtu_brings_everything_back(trunk, tmp_path):
    displacement = np.random.default_rng(0).normal(size=trunk.nodes.shape)
    trunk = replace(trunk, bone_names=("T7", "côte gauche"))
    write_trunk(tmp_path / "trunk.vtu", trunk, displacement)
    back, moved = read_trunk(tmp_path / "trunk.vtu")
    for field in fields(trunk):
        np.testing.assert_array_equal(getattr(back, field.name), getattr(trunk, field.name))
    np.testing.assert_array_equal(moved, displacement)


def test_vtu_is_plain_for_others(trunk, tmp_path):
    write_trunk(tmp_path / "trunk.vtu", trunk)
    mesh = meshio.read(tmp_path / "trunk.vtu")
    np.testing.assert_array_equal(mesh.points, trunk.nodes)
    np.testing.assert_array_equal(mesh.cells_dict["tetra"], trunk.tets)
    kind = mesh.point_data["node_kind"]
    np.testing.assert_array_equal(np.flatnonzero(kind == 1), np.sort(trunk.skin_nodes))
    np.testing.assert_array_equal(kind == 2, trunk.prescribed)
    np.testing.assert_array_equal(mesh.point_data["bone"], trunk.bone)
    np.testing.assert_array_equal(mesh.point_data["displacement"], 0.0)
    parts = mesh.cell_data_dict["part"]["triangle"]
    assert np.bincount(parts).tolist() == [0, len(trunk.skin_faces), len(trunk.bone_faces)]


def test_what_does_not_fit_is_named(trunk, tmp_path):
    with pytest.raises(InputError, match="one row a node"):
        write_trunk(tmp_path / "trunk.vtu", trunk, np.zeros((3, 3)))
    meshio.write(tmp_path / "foreign.vtu", meshio.Mesh(trunk.nodes, [("tetra", trunk.tets)]))
    with pytest.raises(InputError, match="cannot be read as a trunk mesh"):
        read_trunk(tmp_path / "foreign.vtu")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda t: {"tets": t.tets[:, [1, 0, 2, 3]]}, "positive volume"),
        (lambda t: {"tets": t.tets + 10000}, "'tets' must lie"),
        (lambda t: {"tets": t.tets[:0]}, "no tetrahedra"),
        (lambda t: {"bone": t.bone + 1}, "'bone' must lie"),
        (lambda t: {"bone": t.bone[1:]}, "'bone' must have shape"),
        (lambda t: {"nodes": np.full_like(t.nodes, np.nan)}, "finite"),
        (lambda t: {"skin_nodes": np.zeros_like(t.skin_nodes)}, "node of its own"),
    ],
)
def test_parts_that_do_not_fit_are_named(trunk, change, says):
    with pytest.raises(InputError, match=says):
        check_trunk(replace(trunk, **change(trunk)), "trunk")


def test_volume_of_a_corner_of_a_cube():
    nodes = np.array([[0.0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 4]]) + 1300.0
    np.testing.assert_allclose(tet_volumes(nodes, np.array([[0, 1, 2, 3], [1, 0, 2, 3]])), [4.0, -4.0])
