"""Values, the small ways between them, and derivatives by differences of one step."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from warp_trunk.bone_motion.steps import ARM, jacobian, shifted, way

RNG = np.random.default_rng(4)
MOTION = RigidTransform.from_components([20.0, -5.0, 8.0], Rotation.from_rotvec([0.2, -0.1, 0.3]))


@pytest.mark.parametrize("value", [0.7, RNG.normal(size=(4, 3)), MOTION])
def test_the_way_to_a_value_that_was_shifted_is_the_shift(value: object) -> None:
    by = 1e-4 * RNG.normal(size=len(way(value, value)))
    np.testing.assert_allclose(way(value, shifted(value, by)), by, atol=1e-9)


def test_derivatives_by_each_value_and_through_points_that_are_not_read() -> None:
    points = RNG.normal(size=(5, 3))

    def moved(motion: RigidTransform, points: np.ndarray, factor: float) -> np.ndarray:
        return factor * motion.apply(points[1])

    at = MOTION, points, 2.0
    by_points = jacobian(moved, at, 1).reshape(3, 5, 3)
    np.testing.assert_allclose(by_points[:, 1], 2.0 * MOTION.rotation.as_matrix(), atol=1e-9)
    assert not by_points[:, [0, 2, 3, 4]].any()
    np.testing.assert_allclose(jacobian(moved, at, 2)[:, 0], MOTION.apply(points[1]), atol=1e-9)
    there = MOTION.apply(points[1])
    by_turn = np.transpose([np.cross(axis, there) for axis in np.eye(3)]) / ARM
    np.testing.assert_allclose(jacobian(moved, at, 0), 2.0 * np.hstack([by_turn, np.eye(3)]), atol=1e-8)
