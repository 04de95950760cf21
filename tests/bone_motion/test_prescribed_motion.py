from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from support.meshes import block_with_bone, trunk
from warp_trunk.bone_motion.prescribed_motion import (
    PrescribedMotion,
    colliding_bones,
    extended_displacement,
    folded_tissue,
    rigid_path,
    spline_path,
)
from warp_trunk.geometry.rigid import RigidMotion

RNG = np.random.default_rng(3)
NAMES = tuple(f"m{i}" for i in range(40))


def landmarks(points: np.ndarray, names: tuple[str, ...] = NAMES) -> Any:
    return SimpleNamespace(names=names, points=points)


BEFORE = RNG.uniform(-100, 100, size=(40, 3))
AFTER = BEFORE + RNG.normal(scale=4.0, size=(40, 3))


def test_carries_landmarks_straight() -> None:
    path = spline_path(BEFORE, landmarks(BEFORE), landmarks(AFTER))
    for t in (0.0, 0.3, 1.0):
        np.testing.assert_allclose(BEFORE + path.at(t), BEFORE + t * (AFTER - BEFORE), atol=1e-9)


@pytest.fixture(scope="module")
def jointed():
    """Two bones in a block, and a motion for each."""
    motions = {
        "upper": RigidMotion.exp(np.array([0.1, 0.9, -0.3, 6.0, -2.0, 1.0])),
        "lower": RigidMotion.identity(),
    }
    two = block_with_bone((5, 5, 5), 8.0, holes=((2, 2, 1), (2, 2, 3)))
    return replace(two, bone_names=tuple(motions)), motions


def test_rigid_bones_keep_their_shape_at_every_increment(jointed) -> None:
    trunk, motions = jointed
    path = rigid_path(trunk, motions)
    for t in np.linspace(0.1, 1.0, 10):
        nodes = trunk.nodes + path.at(t)
        for number in range(2):
            mine = np.flatnonzero(trunk.bone == number)
            before, after = (p[mine][:, None] - p[mine][None] for p in (trunk.nodes, nodes))
            assert np.abs(np.linalg.norm(after, axis=2) - np.linalg.norm(before, axis=2)).max() < 1e-6
        off_bone = trunk.bone < 0
        np.testing.assert_array_equal(path.at(t)[off_bone], t * path.displacement[off_bone])
    upper = trunk.bone == 0
    nodes = trunk.nodes + path.at(1.0)
    np.testing.assert_allclose(nodes[upper], motions["upper"].apply(trunk.nodes[upper]), atol=1e-9)
    np.testing.assert_array_equal(path.displacement, path.at(1.0))
    np.testing.assert_array_equal(path.at(0.4)[trunk.bone == 1], 0.0)


def test_the_path_of_some_nodes_is_that_of_all(jointed) -> None:
    trunk, motions = jointed
    path = rigid_path(trunk, motions)
    nodes = np.random.default_rng(4).permutation(len(trunk.nodes))[: len(trunk.nodes) // 2]
    assert {-1, 0} <= set(trunk.bone[nodes])
    for t in (0.3, 1.0):
        np.testing.assert_allclose(path.of(nodes).at(t), path.at(t)[nodes], atol=1e-12)
    only_tissue = np.flatnonzero(trunk.bone < 0)
    np.testing.assert_array_equal(path.of(only_tissue).at(0.3), 0.3 * path.displacement[only_tissue])


LATTICE = np.random.default_rng(8).uniform(-100.0, 100.0, size=(1500, 3))
HELD = np.flatnonzero(np.linalg.norm(LATTICE, axis=1) < 60.0)


def test_nodes_on_bone_go_where_they_are_told() -> None:
    moved = RNG.normal(scale=5.0, size=(len(HELD), 3))
    np.testing.assert_allclose(extended_displacement(LATTICE, HELD, moved)[HELD], moved, atol=1e-5)


# one tetrahedron between two bones, one with a free corner
FIVE = np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10], [0, 0, -10]])
TWO_TETS = replace(
    trunk(FIVE, np.array([[0, 1, 2, 3], [0, 2, 1, 4]]), np.arange(4)),
    bone=np.array([0, 0, 0, 1, -1], dtype=np.int32),
    bone_names=("T8", "T9"),
)


def moved(node: int, by: float) -> PrescribedMotion:
    path = np.zeros_like(FIVE)
    path[node, 2] = by
    return PrescribedMotion(path)


def test_bones_that_pass_through_each_other_are_named():
    (text,) = colliding_bones(TWO_TETS, moved(3, -11.0))
    assert "T8 and T9" in text
    assert "(2, 2, 2) mm" in text


def test_a_fold_that_tissue_can_undo_is_no_collision():
    assert colliding_bones(TWO_TETS, moved(4, 11.0)) == []
    (text,) = folded_tissue(TWO_TETS, moved(4, 11.0))
    assert text.startswith("the path of the bones folds tissue at T8, around")
