"""Means, limits of agreement, shares and trends by hand, and intervals against known ones."""

import numpy as np
import pytest

from support.asserting import there
from warp_trunk.cohort.statistics import limits_of_agreement, over_patients, trend


def test_each_patient_counts_once():
    """Patient a: (1 + 3) / 2 = 2; b: 5; c: 8. Mean 5, deviations -3, 0, 3, so SD 3."""
    found = there(over_patients([1.0, 3.0, 5.0, 8.0], ["a", "a", "b", "c"]))
    assert (found.mean, found.sd, found.patients) == (5.0, 3.0, 3)


def test_an_interval_of_three_patients_goes_from_the_least_to_the_most():
    """All three draws are the least patient in 1 of 27, more often than 2.5 %."""
    found = there(over_patients([2.0, 5.0, 8.0], ["a", "b", "c"]))
    assert (found.low, found.high) == (2.0, 8.0)


def test_the_interval_of_many_patients_is_the_normal_one():
    """Of 200 patients, 100 at 0 and 100 at 1: standard error 0.5 / sqrt(200) = 0.0354."""
    found = there(over_patients([0.0, 1.0] * 100, [str(n) for n in range(200)]))
    assert found.low == pytest.approx(0.5 - 1.96 * 0.0354, abs=0.006)
    assert found.high == pytest.approx(0.5 + 1.96 * 0.0354, abs=0.006)


@pytest.mark.parametrize(("values", "sd"), [([2.0], None), ([2.0, 4.0], np.sqrt(2.0))])
def test_few_patients_have_no_interval(values, sd):
    found = there(over_patients(values, [str(n) for n in range(len(values))]))
    assert found.sd == (None if sd is None else pytest.approx(sd))
    assert found.low is None
    assert found.high is None


def test_one_pair_each_is_the_plain_limit():
    """1, 2, 3: mean 2, SD 1, limits 2 ± 1.96."""
    found = there(limits_of_agreement([1.0, 2.0, 3.0], ["a", "b", "c"]))
    assert (found.bias, found.sd) == (2.0, 1.0)
    assert (found.low, found.high) == (pytest.approx(0.04), pytest.approx(3.96))


def test_several_pairs_add_what_lies_within_and_between_patients():
    """a: 0, 2; b: 4, 6. Within: (1 + 1 + 1 + 1) / (4 - 2) = 2. Between: 2 (4 + 4) / 1 = 16. Pairs of each:
    (4 - 8 / 4) / 1 = 2. Variance of patients (16 - 2) / 2 = 7, of a difference 2 + 7 = 9."""
    found = there(limits_of_agreement([0.0, 2.0, 4.0, 6.0], ["a", "a", "b", "b"]))
    assert (found.bias, found.sd, found.pairs, found.patients) == (3.0, 3.0, 4, 2)


def test_limits_hold_what_they_promise():
    """Of single differences of new patients, 95 %: 12 levels each, patients vary by 2 and levels by 1."""
    random = np.random.default_rng(3)
    drawn = random.normal(0.0, 2.0, (2000, 1)) + random.normal(0.0, 1.0, (2000, 12))
    found = there(limits_of_agreement(drawn.ravel().tolist(), np.repeat(np.arange(2000), 12).astype(str).tolist()))
    assert found.sd == pytest.approx(np.sqrt(5.0), rel=0.03)


def test_a_line_by_hand():
    """Points (0, 1), (1, 3), (2, 2): slope 1 / 2, intercept 1.5, correlation 1 / sqrt(2 * 2) = 0.5."""
    found = there(trend([0.0, 1.0, None, 2.0, 9.0], [1.0, 3.0, 7.0, 2.0, None]))
    assert (found.slope, found.intercept, found.correlation) == (
        pytest.approx(0.5), pytest.approx(1.5), pytest.approx(0.5),
    )  # fmt: skip
    assert found.p == pytest.approx(
        2.0 / 3.0
    )  # t = 0.5 / sqrt(0.75) = 1 / sqrt(3), one degree of freedom: 60 degrees
    assert found.points == 3
