"""Derivatives of a spline in its landmarks, against differences of splines fitted again."""

import numpy as np
import pytest

from warp_trunk.geometry.spline import SplineDerivative, fit_spline

RNG = np.random.default_rng(8)
CENTRE = np.array([0.0, 30.0, 1200.0])
BEFORE = CENTRE + RNG.uniform(-200.0, 200.0, size=(20, 3))
AFTER = BEFORE + RNG.normal(scale=10.0, size=BEFORE.shape)
POINTS = np.vstack([CENTRE + RNG.uniform(-250.0, 250.0, size=(60, 3)), BEFORE[:1] + 1.0])


@pytest.mark.parametrize("seed", range(6))
def test_against_differences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    before, after = rng.normal(size=BEFORE.shape) * (seed != 1), rng.normal(size=AFTER.shape) * (seed != 0)
    step = 1e-4

    def moved(sign: float) -> np.ndarray:
        return fit_spline(BEFORE + sign * step * before, AFTER + sign * step * after).displacement(POINTS)

    wanted = (moved(1.0) - moved(-1.0)) / (2.0 * step)
    derivative = SplineDerivative(BEFORE, AFTER, POINTS)
    weights = rng.normal(size=(2, *POINTS.shape))
    for weight, by_before, by_after in zip(weights, *derivative.adjoint(weights), strict=True):
        predicted = np.vdot(by_before, before) + np.vdot(by_after, after)
        assert predicted == pytest.approx(np.vdot(weight, wanted), rel=1e-6)


def test_carrying_all_landmarks_along_is_a_shift_of_the_points() -> None:
    """Ends that go further by d take every point along; a spline whose landmarks shift by d is u(x - d)."""
    weight = RNG.normal(size=POINTS.shape)
    (by_before,), (by_after,) = SplineDerivative(BEFORE, AFTER, POINTS).adjoint(weight[None])
    np.testing.assert_allclose(by_after.sum(axis=0), weight.sum(axis=0), atol=1e-9)
    slope = fit_spline(BEFORE, AFTER).jacobian(POINTS) - np.eye(3)
    expected = -np.einsum("pi,pij->j", weight, slope)
    np.testing.assert_allclose((by_before + by_after).sum(axis=0), expected, atol=1e-9)
