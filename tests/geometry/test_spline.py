from typing import Literal

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from warp_trunk.errors import InputError
from warp_trunk.geometry.spline import SplineSums, fit_spline, spline_response

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
    placed = fit_spline(SOURCES, TARGETS, nugget, drift=drift)(POINTS)
    np.testing.assert_allclose(placed, POINTS + reference(POINTS), atol=1e-8)


def test_landmarks_that_stay_give_the_identity_to_the_bit() -> None:
    np.testing.assert_array_equal(fit_spline(SOURCES, SOURCES)(POINTS), POINTS)


def test_jacobian_matches_central_differences() -> None:
    spline = fit_spline(SOURCES, TARGETS)
    h = 1e-4
    columns = [(spline(POINTS + h * e) - spline(POINTS - h * e)) / (2 * h) for e in np.eye(3)]
    np.testing.assert_allclose(spline.jacobian(POINTS), np.stack(columns, axis=2), atol=1e-7)


NAMES = [f"mark{i}" for i in range(60)]


def test_sums_of_many_splines_are_those_of_each() -> None:
    """Of landmarks as they are, moved by a little and by much, before and after."""
    rng, weights = np.random.default_rng(2), np.random.default_rng(3).normal(size=(4, len(POINTS)))
    sizes = np.array([[0.0, 0.0], [0.0, 5.0], [1e-4, 0.0], [5.0, 5.0]])[:, :, None, None]
    before, after = (np.array([SOURCES, TARGETS]) + sizes * rng.normal(size=(4, 2, *SOURCES.shape))).transpose(
        1, 0, 2, 3
    )
    sums_of_sets = SplineSums(POINTS, weights, SOURCES).at(before, after)
    for sums, sources, targets in zip(sums_of_sets, before, after, strict=True):
        np.testing.assert_allclose(sums, weights @ fit_spline(sources, targets).displacement(POINTS), atol=1e-8)


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
