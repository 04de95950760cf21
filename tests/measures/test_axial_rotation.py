"""Axial rotation of vertebrae that are turned by known angles."""

import math

import numpy as np
import pytest

from support.trunk_shapes import LEFT, rotation, spine, with_points
from warp_trunk.measures.apical import axial_rotation
from warp_trunk.measures.spine import spine_of


def pedicles(level, degrees, tilt=0.0, centre=(5.0, 40.0, 200.0)):
    """Pedicles 30 mm apart, turned clockwise seen from above, in a vertebra that leans to the left."""
    c, s = math.cos(math.radians(tilt)), math.sin(math.radians(tilt))
    lean = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    turn = np.eye(3)
    turn[:2, :2] = rotation(-degrees)
    return {
        f"{level}_{side}_pedicle_{end}": np.array(centre) + lean @ turn @ np.array([x, 8.0, z])
        for side, x in (("left", 15.0), ("right", -15.0))
        for end, z in (("superior", 5.0), ("inferior", -5.0))
    }


@pytest.mark.parametrize("degrees", [0.0, 17.0, -23.0, 60.0])
def test_vertebra_turned_by_an_angle_has_it(degrees):
    turned = spine_of(with_points(spine({}), pedicles("T8", degrees)))
    assert axial_rotation(turned, LEFT)["T8"] == pytest.approx(degrees, abs=1e-9)


def test_leaning_aside_is_no_rotation():
    leaning = spine_of(with_points(spine({}), pedicles("T8", 0.0, tilt=35.0)))
    assert axial_rotation(leaning, LEFT)["T8"] == pytest.approx(0.0, abs=1e-9)
