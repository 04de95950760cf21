"""Topology and order of tetrahedra against Python sets, and the parts of a trunk and its file."""

from __future__ import annotations

from dataclasses import fields, replace
from itertools import pairwise

import meshio
import numpy as np
import pytest

from support.small_trunk import small_trunk
from warp_trunk.engine.ordering import bisect
from warp_trunk.engine.topology import (
    find_pieces,
)
from warp_trunk.engine.trunk_mesh import check_trunk, tet_volumes
from warp_trunk.errors import InputError
from warp_trunk.io.trunk_file import read_trunk, write_trunk


def test_pieces_have_the_number_of_their_lowest_node() -> None:
    """A chain whose numbers fall and rise, so that a label has to go both ways, and two pieces more."""
    chain = np.array([[k + 3, k + 2, k + 1, k] for k in [*range(60, 100), *range(0, 63)]])
    other = np.array([[110, 111, 112, 113], [113, 104, 105, 106]])
    expected = np.arange(115)
    expected[:103] = 0
    expected[[104, 105, 106, 110, 111, 112, 113]] = 104
    np.testing.assert_array_equal(find_pieces(np.concatenate([chain, other]), 115), expected)


POINTS = np.random.default_rng(0).uniform(size=(1000, 3)) * [10.0, 3.0, 1.0]


@pytest.mark.parametrize(
    ("points", "parts"),
    [(POINTS[:1], 1), (POINTS[:2], 2), (POINTS[:3], 2), (POINTS[:17], 8), (POINTS, 16), (np.zeros((64, 3)), 8)],
)
def test_order_is_a_permutation_in_equal_compact_parts(points: np.ndarray, parts: int) -> None:
    """Parts of a 10 x 3 x 1 box have less than a third of its spread; the first cut is across its longest axis."""
    order, bounds = bisect(points, parts)
    assert sorted(order) == list(range(len(points)))
    assert (bounds[0], bounds[-1], len(bounds)) == (0, len(points), parts + 1)
    sizes = np.diff(bounds)
    assert sizes.min() >= 1
    assert np.abs(sizes - len(points) / parts).max() <= np.ceil(np.log2(max(parts, 2)))
    if parts == 16:
        spread = [np.linalg.norm(np.ptp(points[order[a:b]], axis=0)) for a, b in pairwise(bounds)]
        assert max(spread) < np.linalg.norm(np.ptp(points, axis=0)) / 3.0
        low, high = points[order[: bounds[8]], 0], points[order[bounds[8] :], 0]
        assert low.max() <= high.min()


@pytest.fixture(scope="module")
def trunk():
    return small_trunk()[0]


def test_vtu_brings_everything_back_and_is_plain_for_others(trunk, tmp_path):
    displacement = np.random.default_rng(0).normal(size=trunk.nodes.shape)
    trunk = replace(trunk, bone_names=("T7", "côte gauche"))
    write_trunk(tmp_path / "trunk.vtu", trunk, displacement)
    back, moved = read_trunk(tmp_path / "trunk.vtu")
    for field in fields(trunk):
        np.testing.assert_array_equal(getattr(back, field.name), getattr(trunk, field.name))
    np.testing.assert_array_equal(moved, displacement)
    mesh = meshio.read(tmp_path / "trunk.vtu")
    np.testing.assert_array_equal(mesh.points, trunk.nodes)
    np.testing.assert_array_equal(mesh.cells_dict["tetra"], trunk.tets)
    kind = mesh.point_data["node_kind"]
    np.testing.assert_array_equal(np.flatnonzero(kind == 1), np.sort(trunk.skin_nodes))
    np.testing.assert_array_equal(kind == 2, trunk.prescribed)
    np.testing.assert_array_equal(mesh.point_data["bone"], trunk.bone)
    np.testing.assert_array_equal(mesh.point_data["displacement"], displacement)
    parts = mesh.cell_data_dict["part"]["triangle"]
    assert np.bincount(parts).tolist() == [0, len(trunk.skin_faces), len(trunk.bone_faces)]


def test_what_does_not_fit_is_named(trunk, tmp_path):
    with pytest.raises(InputError, match="one row a node"):
        write_trunk(tmp_path / "trunk.vtu", trunk, np.zeros((3, 3)))
    meshio.write(tmp_path / "foreign.vtu", meshio.Mesh(trunk.nodes, [("tetra", trunk.tets)]))
    with pytest.raises(InputError, match="cannot be read as a trunk mesh"):
        read_trunk(tmp_path / "foreign.vtu")
    twice = np.vstack([trunk.tets, trunk.tets[5:6, [1, 2, 0, 3]]])
    for change, says in (
        ({"tets": twice}, "corners of an earlier one"),
        ({"skin_nodes": 0 * trunk.skin_nodes}, "node of its own"),
    ):
        with pytest.raises(InputError, match=says):
            check_trunk(replace(trunk, **change), "trunk")


def test_volume_of_a_corner_of_a_cube():
    nodes = np.array([[0.0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 4]]) + 1300.0
    np.testing.assert_allclose(tet_volumes(nodes, np.array([[0, 1, 2, 3], [1, 0, 2, 3]])), [4.0, -4.0])
