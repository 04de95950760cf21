"""Least squares with priors against closed forms and against constants that are known."""

from collections.abc import Sequence

import numpy as np
import pytest

from warp_trunk.cohort.calibration.fit import Prior, certainty, find, without


def prior(*, weight: float = 1.0, mean: Sequence[float] = (0.0, 0.0), sd: Sequence[float] = (1.0, 2.0)) -> Prior:
    ends = np.full(len(mean), 9.0)
    return Prior(mean=np.array(mean), sd=np.array(sd), low=-ends, high=ends, weight=weight)


def linear(seed: int, patients: int, truth: np.ndarray, noise: float):
    """Patients whose residuals are linear in the constants, each with an error that her places share."""
    random = np.random.default_rng(seed)
    parts = {}
    for number in range(patients):
        J = random.standard_normal((30, len(truth)))
        parts[str(number)] = (J, J @ random.standard_normal(len(truth)) * noise)

    def evaluate(x: np.ndarray):
        return {name: (J @ (x - truth) + own, J) for name, (J, own) in parts.items()}

    return evaluate


def test_one_place_and_a_prior_by_hand():
    """Residual x - 3 with deviation 1, prior 0 ± 1: the middle, 1.5, variance 1 / 2, half of it from the place."""
    believed = prior(mean=(0.0,), sd=(1.0,))
    found = find(lambda x: {"a": (np.array([x[0] - 3.0]), np.ones((1, 1)))}, believed)
    assert found.converged
    assert found.counted[0] == pytest.approx(1.5)
    sure = certainty(found.pieces, believed)
    assert sure.sd[0] == pytest.approx(np.sqrt(0.5))
    assert sure.from_data[0] == pytest.approx(0.5)
    assert sure.width == pytest.approx(1.96, abs=0.001)


def test_without_a_prior_the_truth_comes_back():
    truth = np.array([1.2, -0.7])
    found = find(linear(1, 5, truth, 0.0), prior(weight=0.0))
    assert found.counted == pytest.approx(truth, abs=1e-6)
    assert certainty(found.pieces, prior(weight=0.0)).from_data == pytest.approx([1.0, 1.0])


def test_where_nothing_is_known_a_shorter_step_is_taken():
    """Residual sinh(x) - 1 from 0.1, whose first step leads beyond 0.95: what is worse there is not lost."""

    def evaluate(x: np.ndarray):
        known = np.minimum(x, 0.95)
        worse = 3.0 if x[0] > 0.95 else 1.0
        return {"a": (worse * (np.sinh(known) - 1.0), np.cosh(known)[:, None])}

    found = find(evaluate, prior(weight=0.0, mean=(0.1,), sd=(1.0,)))
    assert found.counted[0] == pytest.approx(np.arcsinh(1.0), abs=2e-3)


def test_intervals_hold_the_truth_as_often_as_they_say():
    """Errors that all places of a patient share: intervals from places alone would hold it in a third of cases."""
    truth, inside, draws = np.array([0.5, -0.3]), 0, 150
    for seed in range(draws):
        believed = prior(weight=1e-6)
        found = find(linear(seed, 12, truth, 1.0), believed)
        sure = certainty(found.pieces, believed)
        inside += int((np.abs(found.counted - truth) <= sure.width * sure.sd).sum())
    assert 0.90 <= inside / (2 * draws) <= 0.99


def test_leaving_a_patient_out_is_the_fit_to_the_others():
    evaluate, believed = linear(4, 6, np.array([0.4, 0.9]), 0.5), prior()
    found = find(evaluate, believed)
    others = find(lambda x: {name: piece for name, piece in evaluate(x).items() if name != "2"}, believed)
    assert without(found.pieces, "2", found.counted, believed) == pytest.approx(others.counted, abs=1e-5)


def test_constants_that_only_act_together_are_correlated():
    J = np.ones((20, 2))
    sure = certainty({"a": (np.zeros(20), J)}, prior(sd=(1.0, 1.0)))
    assert sure.correlation[0, 1] < -0.9
    assert sure.from_data == pytest.approx([20.0 / 41.0] * 2)
