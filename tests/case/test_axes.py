from itertools import permutations, product

import numpy as np
import pytest

from warp_trunk.case import Axes
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import enclosed_volume

LEFT, BACK, UP = np.eye(3)
MEANING = {"L": LEFT, "R": -LEFT, "P": BACK, "A": -BACK, "S": UP, "I": -UP}
CODES = ["".join(code) for pairs in permutations(("LR", "PA", "SI")) for code in product(*pairs)]

TETRAHEDRON = Surface(
    np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], dtype=np.int32),
)


@pytest.mark.parametrize("code", CODES)
def test_each_axis_goes_where_its_letter_says(code):
    for axis, letter in enumerate(code):
        np.testing.assert_array_equal(Axes(code).points_to_lps(np.eye(3)[[axis]]), [MEANING[letter]])
    points = np.random.default_rng(1).normal(size=(5, 3))
    np.testing.assert_allclose(Axes(code).points_to_lps(points), points @ Axes(code).matrix.T, rtol=1e-15)


@pytest.mark.parametrize("code", CODES)
def test_triangles_stay_outward(code):
    """A file in left-handed axes looks outward when drawn in right-handed ones: reading mirrors it."""
    turned = Axes(code).surface_to_lps(TETRAHEDRON)
    assert enclosed_volume(turned) == pytest.approx(1.0 / 6.0)


@pytest.mark.parametrize(("units", "size"), [("mm", 1.0), ("cm", 10.0), ("m", 1000.0)])
def test_units_become_millimetres(units, size):
    np.testing.assert_array_equal(Axes("RAS").points_to_lps(np.ones((1, 3)), units), [[-size, -size, size]])
