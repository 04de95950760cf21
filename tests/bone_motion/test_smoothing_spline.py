"""Smoothing splines against SciPy's, and their smoothness against a likelihood written apart."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, make_smoothing_spline

from warp_trunk.bone_motion.vertebra_smoothing import likeliest_smoothness, roughness_of, smoother

ALONG = np.cumsum(np.random.default_rng(4).uniform(15.0, 30.0, 17))
VARIANCE = np.random.default_rng(5).uniform(0.5, 2.0, 17)


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(6)


def test_roughness_is_the_integral_of_the_curvature_squared(random: np.random.Generator) -> None:
    values = random.normal(size=17)
    spline = CubicSpline(ALONG, values, bc_type="natural")
    fine = np.linspace(ALONG[0], ALONG[-1], 200_001)
    wanted = np.trapezoid(np.square(spline(fine, 2)), fine)
    assert values @ roughness_of(ALONG) @ values == pytest.approx(wanted, rel=1e-6)
    np.testing.assert_allclose(roughness_of(ALONG) @ (3.0 + 2.0 * ALONG), 0.0, atol=1e-9)


@pytest.mark.parametrize("smoothness", [1e-2, 1e2, 1e5])
def test_smoothed_values_are_those_of_scipy(random: np.random.Generator, smoothness: float) -> None:
    values = random.normal(size=17)
    wanted = make_smoothing_spline(ALONG, values, w=1.0 / VARIANCE, lam=smoothness)(ALONG)
    found = smoother(smoothness, VARIANCE, roughness_of(ALONG)) @ values
    np.testing.assert_allclose(found, wanted, atol=1e-7)


def test_smoothness_is_likeliest(random: np.random.Generator) -> None:
    """The density of what is left of the values without a straight line: a Gaussian, by its covariance."""
    values = np.sin(ALONG / 60.0) * 3.0 + np.sqrt(VARIANCE) * random.normal(size=17)
    roughness = roughness_of(ALONG)
    line = np.column_stack([np.ones(17), ALONG])
    contrasts = np.linalg.qr(line, mode="complete")[0][:, 2:].T
    wander = np.linalg.pinv(roughness)

    def likelihood(smoothness: float) -> float:
        covariance = contrasts @ (np.diag(VARIANCE) + wander / smoothness) @ contrasts.T
        seen = contrasts @ values
        return -0.5 * float(np.linalg.slogdet(covariance)[1] + seen @ np.linalg.solve(covariance, seen))

    found = likeliest_smoothness(values, VARIANCE, roughness)
    others = found * np.array([0.5, 0.9, 1.1, 2.0, 1e-3, 1e3])
    assert all(likelihood(found) > likelihood(float(other)) for other in others)
