import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from warp_trunk.errors import InputError
from warp_trunk.geometry.spline import fit_spline

RNG = np.random.default_rng(7)
SOURCES = RNG.uniform([-150, -200, 700], [150, 50, 1400], size=(60, 3))
TARGETS = SOURCES + RNG.normal(scale=15.0, size=(60, 3))
POINTS = RNG.uniform([-250, -250, 600], [250, 100, 1500], size=(500, 3))


@pytest.mark.parametrize("nugget", [0.0, 0.5, 40.0])
def test_agrees_with_scipy(nugget: float) -> None:
    # SciPy's "linear" kernel is -r with the smoothing added: the same system by another sign
    reference = RBFInterpolator(SOURCES, TARGETS, kernel="linear", degree=1, smoothing=nugget)
    np.testing.assert_allclose(fit_spline(SOURCES, TARGETS, nugget)(POINTS), reference(POINTS), atol=1e-8)


def test_meets_its_landmarks() -> None:
    assert np.abs(fit_spline(SOURCES, TARGETS)(SOURCES) - TARGETS).max() < 1e-9


def test_reproduces_affine_maps() -> None:
    A = np.eye(3) + 0.3 * RNG.normal(size=(3, 3))
    b = np.array([12.0, -7.0, 300.0])
    assert np.abs(fit_spline(SOURCES, SOURCES @ A.T + b)(POINTS) - (POINTS @ A.T + b)).max() < 1e-9


def test_landmarks_that_stay_give_the_identity_to_the_bit() -> None:
    np.testing.assert_array_equal(fit_spline(SOURCES, SOURCES)(POINTS), POINTS)


def test_a_larger_nugget_lies_further_from_the_landmarks_and_ends_in_least_squares() -> None:
    misses = [np.linalg.norm(fit_spline(SOURCES, TARGETS, g)(SOURCES) - TARGETS) for g in (0, 1, 10, 100, 1e9)]
    assert misses == sorted(misses)
    P = np.column_stack([np.ones(len(SOURCES)), SOURCES])
    affine = P @ np.linalg.lstsq(P, TARGETS, rcond=None)[0]
    np.testing.assert_allclose(fit_spline(SOURCES, TARGETS, 1e9)(SOURCES), affine, atol=1e-4)


def test_jacobian_matches_central_differences() -> None:
    spline = fit_spline(SOURCES, TARGETS)
    h = 1e-4
    columns = [(spline(POINTS + h * e) - spline(POINTS - h * e)) / (2 * h) for e in np.eye(3)]
    np.testing.assert_allclose(spline.jacobian(POINTS), np.stack(columns, axis=2), atol=1e-7)


def test_jacobian_at_a_landmark_is_finite() -> None:
    assert np.isfinite(fit_spline(SOURCES, TARGETS).jacobian(SOURCES)).all()


NAMES = [f"mark{i}" for i in range(60)]


def test_coincident_landmarks_are_named() -> None:
    sources = SOURCES.copy()
    sources[17] = sources[4]
    with pytest.raises(InputError, match="'mark4' and 'mark17'"):
        fit_spline(sources, TARGETS, names=NAMES)
    fit_spline(sources, TARGETS, nugget=1.0, names=NAMES)  # two readings of one landmark: what a nugget is for


def test_coplanar_landmarks_are_named() -> None:
    flat = SOURCES[:5] * [1.0, 1.0, 0.0] + SOURCES[:5, :1] * [0.0, 0.0, 0.4]
    with pytest.raises(InputError, match=r"one plane.*mark0, mark1, mark2, mark3, mark4"):
        fit_spline(flat, TARGETS[:5], names=NAMES[:5])


def test_three_landmarks_are_too_few() -> None:
    with pytest.raises(InputError, match=r"at least 4 .*mark0, mark1, mark2"):
        fit_spline(SOURCES[:3], TARGETS[:3], names=NAMES[:3])


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_named(value: float) -> None:
    targets = TARGETS.copy()
    targets[9, 1] = value
    with pytest.raises(InputError, match="mark9"):
        fit_spline(SOURCES, targets, names=NAMES)


def test_shapes_and_nugget_are_checked() -> None:
    with pytest.raises(InputError, match="shape"):
        fit_spline(SOURCES, TARGETS[:-1])
    with pytest.raises(InputError, match="one for each"):
        fit_spline(SOURCES, TARGETS, names=NAMES[:3])
    for nugget in (-1.0, float("nan")):
        with pytest.raises(InputError, match="nugget"):
            fit_spline(SOURCES, TARGETS, nugget=nugget)


@pytest.mark.parametrize("nugget", [0.0, 3.0])
def test_a_constant_drift_agrees_with_scipy(nugget: float) -> None:
    reference = RBFInterpolator(SOURCES, TARGETS - SOURCES, kernel="linear", degree=0, smoothing=nugget)
    expected = POINTS + reference(POINTS)
    np.testing.assert_allclose(fit_spline(SOURCES, TARGETS, nugget, drift="constant")(POINTS), expected, atol=1e-8)


def test_a_constant_drift_needs_one_landmark_and_shifts_by_it() -> None:
    spline = fit_spline(SOURCES[:1], TARGETS[:1], drift="constant")
    np.testing.assert_allclose(spline(POINTS), POINTS + TARGETS[0] - SOURCES[0], atol=1e-9)
    with pytest.raises(InputError, match="drift"):
        fit_spline(SOURCES, TARGETS, drift="cubic")  # pyright: ignore[reportArgumentType]


def test_bending_is_what_is_not_affine() -> None:
    spline = fit_spline(SOURCES, TARGETS)
    expected = np.linalg.norm(POINTS[:, None] - SOURCES[None], axis=2) @ spline.weights
    np.testing.assert_allclose(spline.bending(POINTS), expected, atol=1e-8)
