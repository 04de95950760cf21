import numpy as np
import pytest

from warp_trunk.geometry.surface_checks import check_solid, enclosed_volume
from warp_trunk.preparation.phantom.bones import rod, tube
from warp_trunk.preparation.phantom.skin import stack


def test_a_tube_of_circles_is_a_cylinder_with_cones():
    z = np.array([0.0, 3.0, 13.0, 16.0])
    ones = np.ones((4, 1))
    surface = tube(
        z[:, None] * [0.0, 0.0, 1.0],
        ones * [1.0, 0.0, 0.0],
        ones * [0.0, 1.0, 0.0],
        np.full(4, 5.0),
        np.full(4, 5.0),
        around=100,
    )
    check_solid(surface, "tube")
    # a cylinder of height 10 and two cones of height 3, all of radius 5
    assert enclosed_volume(surface) == pytest.approx(np.pi * 25.0 * (10.0 + 2.0), rel=1e-3)


def test_a_straight_rod_is_a_capsule():
    guide = np.array([[0.0, 0.0, 0.0], [0.0, 30.0, 0.0], [0.0, 60.0, 0.0]])
    surface = rod(guide, np.full(3, 5.0), np.full(3, 5.0), np.array([0.0, 0.0, 1.0]), spacing=4.0, around=100)
    check_solid(surface, "rod")
    assert np.ptp(surface.vertices[:, 1]) == pytest.approx(60.0)
    capsule = np.pi * 25.0 * 50.0 + 4.0 / 3.0 * np.pi * 125.0
    assert enclosed_volume(surface) == pytest.approx(capsule, rel=0.02)  # a cap has three rings


def test_a_stack_of_half_discs_is_a_frustum():
    def half_loop(radius: float, z: float, count: int) -> np.ndarray:
        angle = np.linspace(0.5 * np.pi, -0.5 * np.pi, count)
        x = radius * np.cos(angle)
        x[[0, -1]] = 0.0
        return np.stack([x, radius * np.sin(angle), np.full(count, z)], axis=1)

    ends = np.array([[[0.0, 0.0, 10.0]], [[0.0, 0.0, 0.0]]])
    surface = stack([ends[0], half_loop(10.0, 10.0, 60), half_loop(20.0, 0.0, 85), ends[1]])
    check_solid(surface, "stack")
    frustum = np.pi * 10.0 / 3.0 * (10.0**2 + 10.0 * 20.0 + 20.0**2)
    assert enclosed_volume(surface) == pytest.approx(frustum, rel=1e-3)
