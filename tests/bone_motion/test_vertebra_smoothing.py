"""Vertebrae smoothed along the spine: against known motions with drawn errors, and splines against SciPy."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, make_smoothing_spline
from scipy.spatial.transform import Rotation

from support.known_spine import before_and_after, with_errors
from warp_trunk.bone_motion.vertebra_smoothing import (
    VertebraSmoothing,
    likeliest_smoothness,
    roughness_of,
    smoother,
    vertebra_smoothing,
    vertebrae_of,
)
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.rigid import fit_rigid

BEFORE, AFTER = before_and_after()
LEVELS = BEFORE.vertebrae()


def smoothing_of(before: Landmarks, after: Landmarks) -> tuple[VertebraSmoothing | None, Landmarks]:
    """The smoothing that landmarks require, and those after it."""
    bodies, here, there = vertebrae_of(before), before.points[None], after.points[None]
    motions = bodies.fit(here, there)
    found = vertebra_smoothing(bodies, motions[0], before.points, after.points)
    return found, Landmarks(after.names, found.smoothed(bodies, motions, here, there)[0]) if found else after


def tumbling(before: Landmarks, after: Landmarks) -> np.ndarray:
    """How far the motion of each vertebra is turned from the true one [degrees], shape (levels,)."""
    off = []
    for level in LEVELS:
        true = fit_rigid(BEFORE.of_bone(level).points, AFTER.of_bone(level).points)
        found = fit_rigid(before.of_bone(level).points, after.of_bone(level).points)
        off.append(np.degrees((found * true.inv()).angle))
    return np.array(off)


def test_landmarks_that_move_rigidly_stay_as_they_are() -> None:
    assert smoothing_of(BEFORE, AFTER)[0] is None
    assert smoothing_of(BEFORE, Landmarks(AFTER.names, AFTER.points.round(3)))[0] is None
    few = [row for row, name in enumerate(BEFORE.names) if name.startswith(("T1_", "T8_", "L2_"))]
    names = tuple(BEFORE.names[row] for row in few)
    rough = Landmarks(names, AFTER.points[few] * 1.1)
    assert smoothing_of(Landmarks(names, BEFORE.points[few]), rough)[0] is None


def test_errors_are_told_and_nearly_halved() -> None:
    raw, found, errors = [], [], []
    for seed in range(20):
        random = np.random.default_rng(seed)
        before, after = with_errors(BEFORE, random), with_errors(AFTER, random)
        smoothing, smooth = smoothing_of(before, after)
        assert smoothing is not None
        errors.append(smoothing.error)
        raw.append(tumbling(before, after))
        found.append(tumbling(before, smooth))
    stated = np.sqrt(2.0 * (2.1**2 + 1.5**2) / 3.0)  # before and after, each axis
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(stated, rel=0.05)
    assert np.sqrt(np.mean(np.square(found))) < 0.65 * np.sqrt(np.mean(np.square(raw)))


def test_each_vertebra_keeps_its_shape_and_others_their_place() -> None:
    random = np.random.default_rng(3)
    before, after = with_errors(BEFORE, random), with_errors(AFTER, random)
    _, moved = smoothing_of(before, after)
    assert moved.names == after.names
    for level in LEVELS:
        here, there = before.of_bone(level).points, moved.of_bone(level).points
        np.testing.assert_allclose(fit_rigid(here, there).apply(here), there, atol=1e-9)
    for name in ("asis_left", "asis_right"):
        np.testing.assert_array_equal(moved.point(name), after.point(name))


def test_a_kink_that_stands_out_of_the_errors_is_followed() -> None:
    """T8 turned by 40 degrees against its neighbours, landmarks off by 0.3 mm, which is 0.6 degrees."""
    random = np.random.default_rng(5)
    points = AFTER.points.copy()
    rows = [row for row, name in enumerate(AFTER.names) if name.startswith("T8_")]
    middle = points[rows].mean(axis=0)
    turn = Rotation.from_euler("z", 40.0, degrees=True)
    points[rows] = turn.apply(points[rows] - middle) + middle
    kinked = Landmarks(AFTER.names, points + 0.3 * random.normal(size=points.shape))
    wanted = fit_rigid(BEFORE.points[rows], points[rows])
    found = fit_rigid(BEFORE.points[rows], smoothing_of(BEFORE, kinked)[1].points[rows])
    assert np.degrees((found * wanted.inv()).angle) < 3.0


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
