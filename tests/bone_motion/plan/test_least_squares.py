"""Least squares, against SciPy's and a problem whose answer is known."""

import numpy as np
import pytest
from scipy import optimize

from warp_trunk.bone_motion.plan.least_motion import least_squares


def rows(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A curve that must be met, and a wall that may not be passed: (x0 + 1)^2 + x1 = 3 and x2 >= 0.4."""
    curve, wall = 1e3 * ((x[0] + 1.0) ** 2 + x[1] - 3.0), 1e3 * max(0.4 - x[2], 0.0)
    slopes = [[2e3 * (x[0] + 1.0), 1e3, 0.0]]
    if not wall:
        return np.array([curve]), np.array(slopes)
    return np.array([curve, wall]), np.array([*slopes, [0.0, 0.0, -1e3]])


def all_rows(x: np.ndarray, weight: np.ndarray) -> np.ndarray:
    return np.concatenate([np.sqrt(weight) * x, np.resize(np.append(rows(x)[0], 0.0), 2)])


@pytest.mark.parametrize("weight", [(1.0, 1.0, 1.0), (0.01, 3.0, 1.0), (0.0, 1.0, 1.0)])
def test_as_scipy_finds_it(weight: tuple[float, ...]) -> None:
    own = np.array(weight)
    expected = optimize.least_squares(
        all_rows, np.zeros(3), "3-point", args=(own,), xtol=1e-15, ftol=1e-15, gtol=1e-14
    )
    np.testing.assert_allclose(least_squares(rows, own), expected.x, atol=1e-5)


def test_linear_rows_are_met_at_once() -> None:
    rng = np.random.default_rng(4)
    a, b, weight = rng.normal(size=(7, 20)), rng.normal(size=7), rng.uniform(0.5, 2.0, 20)
    calls = []

    def linear(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        calls.append(x)
        return a @ x - b, a

    expected = np.linalg.solve(np.diag(weight) + a.T @ a, a.T @ b)
    np.testing.assert_allclose(least_squares(linear, weight), expected, atol=1e-12)
    assert len(calls) == 3  # at the start, after a step, and after one that moves no further


def test_a_first_step_that_leads_up_is_damped() -> None:
    """Gauss-Newton alone diverges on arctan from so far away."""

    def rows_of(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.arctan(x + 3.0), np.diag(1.0 / (1.0 + (x + 3.0) ** 2))

    np.testing.assert_allclose(least_squares(rows_of, np.zeros(1)), [-3.0], atol=1e-7)
