"""Means over patients by hand, and intervals against what is known of them."""

import numpy as np
import pytest

from warp_trunk.cohort.statistics import over_patients


def test_each_patient_counts_once():
    """Patient a: (1 + 3) / 2 = 2; b: 5; c: 8. Mean 5, deviations -3, 0, 3, so SD 3."""
    found = over_patients([1.0, 3.0, 5.0, 8.0], ["a", "a", "b", "c"])
    assert found is not None
    assert (found.mean, found.sd, found.patients) == (5.0, 3.0, 3)


def test_an_interval_of_three_patients_goes_from_the_least_to_the_most():
    """All three draws are the least patient in 1 of 27, more often than 2.5 %."""
    found = over_patients([2.0, 5.0, 8.0], ["a", "b", "c"])
    assert found is not None
    assert (found.low, found.high) == (2.0, 8.0)


def test_more_levels_of_the_same_patients_do_not_narrow_the_interval():
    few = over_patients([1.0, 2.0, 4.0, 7.0], list("abcd"))
    many = over_patients([1.0, 2.0, 4.0, 7.0] * 17, list("abcd") * 17)
    assert few == many


def test_the_interval_of_many_patients_is_the_normal_one():
    """Of 200 patients, 100 at 0 and 100 at 1: standard error 0.5 / sqrt(200) = 0.0354."""
    found = over_patients([0.0, 1.0] * 100, [str(n) for n in range(200)])
    assert found is not None
    assert found.low == pytest.approx(0.5 - 1.96 * 0.0354, abs=0.006)
    assert found.high == pytest.approx(0.5 + 1.96 * 0.0354, abs=0.006)


@pytest.mark.parametrize(("values", "sd"), [([2.0], None), ([2.0, 4.0], np.sqrt(2.0))])
def test_few_patients_have_no_interval(values, sd):
    found = over_patients(values, [str(n) for n in range(len(values))])
    assert found is not None
    assert found.sd == (None if sd is None else pytest.approx(sd))
    assert found.low is None
    assert found.high is None


def test_nothing_has_no_mean():
    assert over_patients([], []) is None
