import numpy as np
from scipy.spatial.transform import Rotation

from warp_trunk.bone_motion.carrying import carry

RNG = np.random.default_rng(8)
NODES = RNG.uniform(-100.0, 100.0, size=(1500, 3))
HELD = np.flatnonzero(np.linalg.norm(NODES, axis=1) < 60.0)


def test_nodes_on_bone_go_where_they_are_told() -> None:
    moved = RNG.normal(scale=5.0, size=(len(HELD), 3))
    np.testing.assert_allclose(carry(NODES, HELD, moved)[HELD], moved, atol=1e-5)


def test_what_all_bones_do_all_nodes_do() -> None:
    way = np.array([3.0, -8.0, 1.0])
    np.testing.assert_allclose(carry(NODES, HELD, np.tile(way, (len(HELD), 1))), np.tile(way, (len(NODES), 1)))


def test_bones_that_stay_move_nothing() -> None:
    assert not carry(NODES, HELD, np.zeros((len(HELD), 3))).any()


def test_close_to_a_bone_a_node_moves_as_that_bone() -> None:
    turn = Rotation.from_rotvec([0.0, 0.0, 0.2])
    moved = np.where(NODES[HELD, :1] > 0.0, turn.apply(NODES[HELD]) - NODES[HELD], 0.0)
    beside = NODES[HELD] + RNG.normal(scale=0.02, size=(len(HELD), 3))
    nodes = np.vstack([NODES, beside])
    found = carry(nodes, HELD, moved)[len(NODES) :]
    assert np.linalg.norm(found - moved, axis=1).max() < 0.2


def test_one_node_on_bone_carries_all() -> None:
    found = carry(NODES, HELD[:1], np.array([[1.0, 2.0, 3.0]]))
    np.testing.assert_allclose(found, np.tile([1.0, 2.0, 3.0], (len(NODES), 1)), atol=1e-12)
