from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from support.synthetic import shell_trunk
from warp_trunk.bone_motion.bone_path import composed_path, rigid_path, spline_path
from warp_trunk.errors import InputError

RNG = np.random.default_rng(3)
NAMES = tuple(f"m{i}" for i in range(40))
NODES = RNG.uniform(-120, 120, size=(200, 3))


def landmarks(points: np.ndarray, names: tuple[str, ...] = NAMES) -> Any:
    return SimpleNamespace(names=names, points=points)


BEFORE = RNG.uniform(-100, 100, size=(40, 3))
AFTER = BEFORE + RNG.normal(scale=4.0, size=(40, 3))


def test_carries_landmarks_straight() -> None:
    path = spline_path(BEFORE, landmarks(BEFORE), landmarks(AFTER))
    for t in (0.0, 0.3, 1.0):
        np.testing.assert_allclose(BEFORE + path.at(t), BEFORE + t * (AFTER - BEFORE), atol=1e-9)


def test_is_the_spline_to_the_landmarks_of_each_load_factor() -> None:
    path = spline_path(NODES, landmarks(BEFORE), landmarks(AFTER))
    part = spline_path(NODES, landmarks(BEFORE), landmarks(BEFORE + 0.35 * (AFTER - BEFORE)))
    np.testing.assert_allclose(path.at(0.35), part.at(1.0), atol=1e-9)


def test_composition_of_one_increment_is_the_same_path() -> None:
    one = composed_path(NODES, landmarks(BEFORE), landmarks(AFTER), 1)
    np.testing.assert_allclose(
        one.at(1.0), spline_path(NODES, landmarks(BEFORE), landmarks(AFTER)).at(1.0), atol=1e-9
    )


def test_composition_ends_elsewhere_but_at_the_landmarks() -> None:
    ends = [composed_path(NODES, landmarks(BEFORE), landmarks(AFTER), n).at(1.0) for n in (1, 10)]
    assert np.abs(ends[1] - ends[0]).max() > 0.01  # why the engine takes `spline_path`
    at_landmarks = composed_path(BEFORE, landmarks(BEFORE), landmarks(AFTER), 10).at(1.0)
    np.testing.assert_allclose(at_landmarks, AFTER - BEFORE, atol=1e-8)


def test_names_must_agree() -> None:
    other = (*NAMES[:-1], "T7_left")
    with pytest.raises(InputError, match="T7_left"):
        spline_path(NODES, landmarks(BEFORE), landmarks(AFTER, other))
    with pytest.raises(InputError, match="order"):
        composed_path(NODES, landmarks(BEFORE), landmarks(AFTER, NAMES[::-1]), 2)


def test_composition_needs_an_increment() -> None:
    with pytest.raises(InputError, match="at least 1"):
        composed_path(NODES, landmarks(BEFORE), landmarks(AFTER), 0)


@pytest.fixture(scope="module")
def jointed():
    """Two spheres that touch, so that they share one surface, and a motion for each."""
    motions = {
        "upper": RigidTransform.from_components([6.0, -2.0, 1.0], Rotation.from_rotvec([0.1, 0.9, -0.3])),
        "lower": RigidTransform.identity(),
    }
    return shell_trunk(), motions


def test_rigid_bones_keep_their_shape_at_every_increment(jointed) -> None:
    trunk, motions = jointed
    path = rigid_path(trunk, motions)
    for t in np.linspace(0.1, 1.0, 10):
        there = trunk.nodes + path.at(t)
        for number in range(2):
            mine = np.flatnonzero(trunk.bone == number)
            before, after = (p[mine][:, None] - p[mine][None] for p in (trunk.nodes, there))
            assert np.abs(np.linalg.norm(after, axis=2) - np.linalg.norm(before, axis=2)).max() < 1e-6
        off_bone = trunk.bone < 0
        np.testing.assert_array_equal(path.at(t)[off_bone], t * path.displacement[off_bone])
    upper = trunk.bone == 0
    there = trunk.nodes + path.at(1.0)
    np.testing.assert_allclose(there[upper], motions["upper"].apply(trunk.nodes[upper]), atol=1e-9)
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


def test_a_bone_without_a_motion_is_named(jointed) -> None:
    trunk, motions = jointed
    with pytest.raises(InputError, match="'lower'"):
        rigid_path(trunk, {"upper": motions["upper"]})
