import numpy as np
import pytest

from support.synthetic import box, shell_trunk, sphere
from warp_trunk.engine.trunk_mesh import check_trunk, tet_volumes
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import manifold_fault
from warp_trunk.meshing import MeshOptions, make_trunk
from warp_trunk.meshing.build import morton_order

SKIN = sphere(100.0)
BONES = {"upper": sphere(25.0, (0.0, 5.0, 22.0), 2), "lower": sphere(25.0, (0.0, 5.0, -22.0), 2)}


@pytest.fixture(scope="module")
def trunk():
    return shell_trunk(tets=6000)


def test_skin_keeps_its_vertices_order_and_faces(trunk):
    np.testing.assert_array_equal(trunk.nodes[trunk.skin_nodes], SKIN.vertices)
    np.testing.assert_array_equal(trunk.skin_faces, SKIN.faces)
    assert abs(len(trunk.tets) - 6000) <= 900
    check_trunk(trunk, "trunk")


def test_bone_nodes_are_those_of_the_bone_surface(trunk):
    np.testing.assert_array_equal(np.unique(trunk.bone_faces), np.flatnonzero(trunk.prescribed))
    assert manifold_fault(Surface(trunk.nodes[trunk.prescribed], _renumbered(trunk))) is None
    assert trunk.bone_names == ("upper", "lower")
    clear = trunk.prescribed & (np.abs(trunk.nodes[:, 2]) > 3.0)
    np.testing.assert_array_equal(trunk.bone[clear], np.where(trunk.nodes[clear, 2] > 0.0, 0, 1))
    centres = np.array([[0.0, 5.0, 22.0], [0.0, 5.0, -22.0]])[trunk.bone[clear]]
    np.testing.assert_allclose(np.linalg.norm(trunk.nodes[clear] - centres, axis=1), 25.0, atol=2.0)


def test_volume_is_skin_less_bones(trunk):
    union = 2 * 4 / 3 * np.pi * 25.0**3  # less the lens of height 2 * 3
    union -= 2 * np.pi / 3.0 * 3.0**2 * (3 * 25.0 - 3.0)
    ball = 4 / 3 * np.pi * 100.0**3
    assert tet_volumes(trunk.nodes, trunk.tets).sum() == pytest.approx(ball - union, rel=0.02)


def test_second_build_comes_from_the_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("WARP_TRUNK_CACHE", str(tmp_path))
    options = MeshOptions(tets=4000, bone_voxel=6.0)
    told = []
    first = make_trunk(SKIN, BONES, options, told.append)
    again = make_trunk(SKIN, BONES, options, told.append)
    assert (first.from_cache, again.from_cache) == (False, True)
    assert len([text for text in told if "of TetGen" not in text]) == 4
    np.testing.assert_array_equal(first.trunk.tets, again.trunk.tets)
    np.testing.assert_array_equal(first.trunk.nodes, again.trunk.nodes)
    assert not make_trunk(SKIN, BONES, MeshOptions(tets=4001, bone_voxel=6.0)).from_cache


def test_bone_just_below_and_through_the_skin():
    slab = box((200.0, 200.0, 100.0), splits=4)
    bones = {"through": sphere(30.0, (0.0, 0.0, 30.0)), "below": sphere(20.0, (60.0, 0.0, 29.5))}
    options = MeshOptions(tets=12000, bone_margin=3.0, bone_voxel=5.0, cache=False)
    trunk = make_trunk(slab, bones, options).trunk
    assert trunk.nodes[trunk.prescribed, 2].max() < 50.0 - 3.0 + 1.0


def _renumbered(trunk):
    number = np.cumsum(trunk.prescribed) - 1
    return number[trunk.bone_faces].astype(np.int32)


def test_cells_of_a_cube_come_in_z_order():
    points = np.stack(np.meshgrid(*(np.arange(4.0),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    shuffled = np.random.default_rng(0).permutation(points)
    ordered = shuffled[morton_order(shuffled)]
    np.testing.assert_array_equal(ordered[:4], [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    # every run of eight is one octant of the cube
    octants = (ordered // 2).reshape(8, 8, 3)
    assert (octants == octants[:, :1]).all()

    np.testing.assert_array_equal(morton_order(np.zeros((3, 3))), [0, 1, 2])
