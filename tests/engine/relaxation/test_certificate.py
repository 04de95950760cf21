"""The chance that a saddle was missed, against dense matrices with a direction of negative curvature or none."""

import math

import numpy as np
import pytest

from warp_trunk.engine.certify import Step, chance_of_saddle, reach

SIZE = 60


def coefficients(matrix: np.ndarray, start: np.ndarray, iterations: int) -> tuple[np.ndarray, np.ndarray]:
    """r . r and p . A p of conjugate gradients with M = 1, up to negative curvature, written apart."""
    r, p, squares, curvatures = start.copy(), start.copy(), [], []
    for _ in range(iterations):
        squares.append(r @ r)
        curvatures.append(p @ matrix @ p)
        if curvatures[-1] <= 0.0:
            break
        r = r - squares[-1] / curvatures[-1] * (matrix @ p)
        p = r + (r @ r) / squares[-1] * p
    return np.array(squares), np.array(curvatures)


def spectrum(lowest: float, decades: float) -> np.ndarray:
    """A diagonal matrix, so that its eigenvectors are the axes."""
    return np.diag(np.append(lowest, np.logspace(-decades, 0.0, SIZE - 1)))


@pytest.mark.parametrize("lowest", [-1e-6, -1e-3, -0.1])
@pytest.mark.parametrize("decades", [1.0, 3.0])
@pytest.mark.parametrize("chance", [0.3, 0.1, 0.03])
def test_saddles_are_missed_no_more_often_than_is_said(lowest: float, decades: float, chance: float) -> None:
    """Of many starts, those whose chance falls below a bound before negative curvature is met."""
    matrix, generator, missed, draws = spectrum(lowest, decades), np.random.default_rng(4), 0, 1000
    for _ in range(draws):
        squares, curvatures = coefficients(matrix, generator.standard_normal(SIZE), 2 * SIZE)
        whole = int(np.argmax(curvatures <= 0.0)) if (curvatures <= 0.0).any() else len(curvatures)
        missed += any(
            chance_of_saddle(squares[:k], curvatures[:k], 1.0, 0.0) <= chance for k in range(4, whole, 4)
        )
    assert missed <= draws * chance + 3.0 * math.sqrt(draws * chance)


def test_the_bound_is_the_part_of_an_eigenvector_of_eigenvalue_0_at_most() -> None:
    """By the least residual polynomial: |q(A) v| over all q with q(0) = 1, a dense least-squares problem."""
    matrix, start = spectrum(1e-2, 2.0), np.random.default_rng(1).standard_normal(SIZE)
    squares, curvatures = coefficients(matrix, start, 12)
    powers = np.stack([np.linalg.matrix_power(matrix, k) @ start for k in range(12)], axis=1)
    least = float(np.linalg.norm(start + powers[:, 1:] @ np.linalg.lstsq(powers[:, 1:], -start, rcond=None)[0]))
    noise = 100.0 * least  # so that the chance is below 1
    found = chance_of_saddle(squares, curvatures, noise, 0.0)
    assert found == pytest.approx(math.sqrt(2.0 / math.pi) * least / noise, rel=1e-6)


def test_what_rounding_hides_is_not_excluded() -> None:
    start = np.random.default_rng(2).standard_normal(SIZE)
    for lowest, wanted in ((1e-3, False), (1e-9, True)):
        squares, curvatures = coefficients(spectrum(lowest, 1.0), start, 200)
        assert (chance_of_saddle(squares, curvatures, 1.0, 1e-6) == math.inf) == wanted
    assert chance_of_saddle(squares, curvatures, 0.0, 0.0) == 1.0


@pytest.mark.parametrize(
    ("steps", "wanted"),
    [([], 0.6 / 0.1), ([Step(1.0, 0.6)], 0.6 / 0.4), ([Step(0.8, 0.2), Step(0.5, 0.4)], 0.6 / 0.75)],
)
def test_the_distance_is_that_within_which_there_is_an_equilibrium(steps: list[Step], wanted: float) -> None:
    """Of the newest step as long as the 0.6 mm that are left: left / (1 - q), by hand."""
    assert reach(0.6, steps, slowest=0.9) == pytest.approx(wanted)
