from typing import Literal

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from warp_trunk.errors import InputError
from warp_trunk.geometry.spline import SplineDerivative, fit_spline, spline_response

RNG = np.random.default_rng(7)
SOURCES = RNG.uniform([-150, -200, 700], [150, 50, 1400], size=(60, 3))
TARGETS = SOURCES + RNG.normal(scale=15.0, size=(60, 3))
POINTS = RNG.uniform([-250, -250, 600], [250, 100, 1500], size=(500, 3))


@pytest.mark.parametrize("drift", ["linear", "constant"])
@pytest.mark.parametrize("nugget", [0.0, 0.5, 40.0])
def test_agrees_with_scipy(nugget: float, drift: Literal["linear", "constant"]) -> None:
    # SciPy's "linear" kernel is -r with the smoothing added: the same system by another sign
    degree = 1 if drift == "linear" else 0
    reference = RBFInterpolator(SOURCES, TARGETS - SOURCES, kernel="linear", degree=degree, smoothing=nugget)
    found = fit_spline(SOURCES, TARGETS, nugget, drift=drift)(POINTS)
    np.testing.assert_allclose(found, POINTS + reference(POINTS), atol=1e-8)


def test_landmarks_that_stay_give_the_identity_to_the_bit() -> None:
    np.testing.assert_array_equal(fit_spline(SOURCES, SOURCES)(POINTS), POINTS)


def test_jacobian_matches_central_differences() -> None:
    spline = fit_spline(SOURCES, TARGETS)
    h = 1e-4
    columns = [(spline(POINTS + h * e) - spline(POINTS - h * e)) / (2 * h) for e in np.eye(3)]
    np.testing.assert_allclose(spline.jacobian(POINTS), np.stack(columns, axis=2), atol=1e-7)


NAMES = [f"mark{i}" for i in range(60)]


@pytest.mark.parametrize("seed", range(3))
def test_the_derivative_against_differences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    before, after = rng.normal(size=SOURCES.shape) * (seed != 1), rng.normal(size=TARGETS.shape) * (seed != 0)
    step = 1e-4

    def moved(sign: float) -> np.ndarray:
        return fit_spline(SOURCES + sign * step * before, TARGETS + sign * step * after).displacement(POINTS)

    wanted = (moved(1.0) - moved(-1.0)) / (2.0 * step)
    derivative = SplineDerivative(SOURCES, TARGETS, POINTS)
    weights = rng.normal(size=(2, *POINTS.shape))
    for weight, by_before, by_after in zip(weights, *derivative.adjoint(weights), strict=True):
        predicted = np.vdot(by_before, before) + np.vdot(by_after, after)
        assert predicted == pytest.approx(np.vdot(weight, wanted), rel=1e-6)


def test_the_response_moves_points_as_the_spline_does() -> None:
    moved = spline_response(SOURCES, POINTS) @ (TARGETS - SOURCES)
    np.testing.assert_allclose(moved, fit_spline(SOURCES, TARGETS).displacement(POINTS), atol=1e-8)
    with pytest.raises(InputError, match="one plane"):
        spline_response(SOURCES * [1.0, 1.0, 0.0], POINTS)


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        (lambda s, t: (np.vstack([s[:17], s[4:5], s[18:]]), t), "'mark4' and 'mark17'"),
        (lambda s, t: (s * [1.0, 1.0, 0.0] + s[:, :1] * [0.0, 0.0, 0.4], t), "one plane.*mark0, mark1, mark2"),
        (lambda s, t: (s[:3], t[:3]), "at least 4 .*mark0, mark1, mark2"),
        (lambda s, t: (s, np.where(np.arange(60)[:, None] == 9, np.inf, t)), "mark9"),
        (lambda s, t: (s, t[:-1]), "shape"),
    ],
    ids=["coincident", "coplanar", "three", "not finite", "shapes"],
)
def test_what_is_wrong_with_landmarks_is_named(change, rule) -> None:
    sources, targets = change(SOURCES, TARGETS)
    with pytest.raises(InputError, match=rule):
        fit_spline(sources, targets, names=NAMES[: len(sources)])
