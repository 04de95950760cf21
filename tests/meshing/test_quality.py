import numpy as np

from support.meshes import grid
from warp_trunk.engine.trunk_mesh import tet_volumes
from warp_trunk.meshing.tetrahedra import improve_quality, mean_ratio


def flattened():
    """A block of tetrahedra with one inner node pushed almost into a face, and its number."""
    nodes, tets, _ = grid((4, 4, 4), 10.0)
    node = int(np.flatnonzero((nodes == [20.0, 20.0, 20.0]).all(axis=1))[0])
    nodes[node] += [9.6, 0.1, 0.2]
    assert tet_volumes(nodes, tets).min() > 0.0
    return nodes, tets, node


def test_regular_flat_and_inverted_tetrahedra():
    regular = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    assert abs(abs(mean_ratio(regular[None])[0]) - 1.0) < 1e-12
    corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    assert abs(mean_ratio(corner[None])[0] - 12.0 * 0.5 ** (2.0 / 3.0) / 9.0) < 1e-12
    assert mean_ratio(corner[[1, 0, 2, 3]][None])[0] < 0.0
    corner[3] = [0.3, 0.3, 0.0]
    assert mean_ratio(corner[None])[0] == 0.0


def test_flat_tetrahedra_get_height_and_the_rest_stays():
    nodes, tets, node = flattened()
    reach = np.zeros(len(nodes))
    reach[node] = np.inf
    before = mean_ratio(nodes[tets]).min()
    moved = improve_quality(nodes, tets, reach)
    assert before < 0.1
    assert mean_ratio(moved[tets]).min() > 0.3
    others = np.delete(np.arange(len(nodes)), node)
    np.testing.assert_array_equal(moved[others], nodes[others])
    np.testing.assert_allclose(tet_volumes(moved, tets).sum(), 40.0**3)


def test_reach_is_kept():
    nodes, tets, _ = flattened()
    reach = np.full(len(nodes), 0.4)
    moved = improve_quality(nodes, tets, reach)
    shift = np.linalg.norm(moved - nodes, axis=1)
    assert 0.0 < shift.max() <= 0.4
    assert mean_ratio(moved[tets]).min() > mean_ratio(nodes[tets]).min()
