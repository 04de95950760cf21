"""The matrix of a spline's displacements at points that stay."""

import numpy as np
import pytest

from warp_trunk.errors import InputError
from warp_trunk.geometry.spline import fit_spline, spline_response

RANDOM = np.random.default_rng(5)
SOURCES = RANDOM.uniform(-200.0, 200.0, (30, 3))
POINTS = RANDOM.uniform(-250.0, 250.0, (50, 3))


def test_it_moves_points_as_the_spline_does() -> None:
    targets = SOURCES + RANDOM.standard_normal((30, 3)) * 20.0
    moved = spline_response(SOURCES, POINTS) @ (targets - SOURCES)
    np.testing.assert_allclose(moved, fit_spline(SOURCES, targets).displacement(POINTS), atol=1e-8)


def test_landmarks_in_one_plane_are_refused() -> None:
    with pytest.raises(InputError, match="one plane"):
        spline_response(SOURCES * [1.0, 1.0, 0.0], POINTS)
