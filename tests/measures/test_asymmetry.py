"""Distance from the mirror image, of shapes whose image is known."""

import numpy as np
import pytest

from support.synthetic import sphere
from support.trunk_shapes import ASIS, rotation, spine
from warp_trunk.measures import mirror_asymmetry

LEVELS = {"T6": 0.0, "L5": -60.0}


@pytest.mark.parametrize("degrees", [0.0, 50.0])
def test_ball_beside_the_sacral_line_stands_out_there(degrees):
    """A ball 5 mm to the right of the line has its image 5 mm to the left: their centres are 10 mm apart."""
    turn = rotation(degrees)
    landmarks = spine(LEVELS, (0.0, 0.0), [tuple(turn @ point) for point in ASIS])
    centre = turn @ [-5.0, 0.0]
    ball = sphere(100.0, (*centre, 0.0), 4)
    image = np.append(-centre, 0.0)
    exact = np.linalg.norm(ball.vertices - image, axis=1) - 100.0
    found = mirror_asymmetry(ball, landmarks)
    np.testing.assert_allclose(found, exact, atol=0.12)
    to_left = (ball.vertices[:, :2] - centre) @ (turn @ [1.0, 0.0])
    assert found[np.argmin(to_left)] == pytest.approx(10.0, abs=0.12)
    assert found[np.argmax(to_left)] == pytest.approx(-10.0, abs=0.12)
