"""Limits of agreement by hand."""

import numpy as np
import pytest

from warp_trunk.cohort.statistics import limits_of_agreement


def test_one_pair_each_is_the_plain_limit():
    """1, 2, 3: mean 2, SD 1, limits 2 ± 1.96."""
    found = limits_of_agreement([1.0, 2.0, 3.0], ["a", "b", "c"])
    assert found is not None
    assert (found.bias, found.sd) == (2.0, 1.0)
    assert (found.low, found.high) == (pytest.approx(0.04), pytest.approx(3.96))


def test_several_pairs_add_what_lies_within_and_between_patients():
    """a: 0, 2; b: 4, 6. Within: (1 + 1 + 1 + 1) / (4 - 2) = 2. Between: 2 (4 + 4) / 1 = 16. Pairs of each:
    (4 - 8 / 4) / 1 = 2. Variance of patients (16 - 2) / 2 = 7, of a difference 2 + 7 = 9."""
    found = limits_of_agreement([0.0, 2.0, 4.0, 6.0], ["a", "a", "b", "b"])
    assert found is not None
    assert (found.bias, found.sd, found.pairs, found.patients) == (3.0, 3.0, 4, 2)


def test_unequal_numbers_of_pairs():
    """a: 0, 2, 4 (mean 2); b: 7. Within: (4 + 0 + 4) / 2 = 4. Mean of all 3.25: between
    3 * 1.5625 + 14.0625 = 18.75. Pairs of each: (4 - 10 / 4) / 1 = 1.5. 4 + (18.75 - 4) / 1.5 = 13.8333."""
    found = limits_of_agreement([0.0, 2.0, 4.0, 7.0], ["a", "a", "a", "b"])
    assert found is not None
    assert found.sd == pytest.approx(np.sqrt(4.0 + 14.75 / 1.5))


def test_patients_that_differ_less_than_their_pairs_add_nothing():
    """a: -1, 1; b: -1, 1: no patient differs from the other, so the variance is that within, 4 / 2 = 2."""
    found = limits_of_agreement([-1.0, 1.0, -1.0, 1.0], ["a", "a", "b", "b"])
    assert found is not None
    assert found.sd == pytest.approx(np.sqrt(2.0))


def test_limits_hold_what_they_promise():
    """Of single differences of new patients, 95 %: 12 levels each, patients vary by 2 and levels by 1."""
    random = np.random.default_rng(3)
    drawn = random.normal(0.0, 2.0, (2000, 1)) + random.normal(0.0, 1.0, (2000, 12))
    found = limits_of_agreement(drawn.ravel().tolist(), np.repeat(np.arange(2000), 12).astype(str).tolist())
    assert found is not None
    assert found.sd == pytest.approx(np.sqrt(5.0), rel=0.03)


def test_too_few():
    assert limits_of_agreement([], []) is None
    alone = limits_of_agreement([1.5], ["a"])
    assert alone is not None
    assert (alone.bias, alone.sd, alone.low) == (1.5, None, None)
