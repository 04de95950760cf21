"""Shares and lines by hand."""

import pytest

from warp_trunk.cohort.statistics import share_true, share_within, trend


def test_shares():
    assert share_within([-2.4, 2.5, 0.0, 3.0], 2.5) == 0.5  # at the limit is not below it
    assert share_true([True, None, False, True]) == pytest.approx(2.0 / 3.0)
    assert share_within([], 2.5) is None
    assert share_true([None]) is None


def test_a_line_by_hand():
    """Points (0, 1), (1, 3), (2, 2): slope 1 / 2, intercept 1.5, correlation 1 / sqrt(2 * 2) = 0.5."""
    found = trend([0.0, 1.0, None, 2.0, 9.0], [1.0, 3.0, 7.0, 2.0, None])
    assert found is not None
    assert (found.slope, found.intercept, found.correlation) == (
        pytest.approx(0.5), pytest.approx(1.5), pytest.approx(0.5),
    )  # fmt: skip
    assert found.p == pytest.approx(
        2.0 / 3.0
    )  # t = 0.5 / sqrt(0.75) = 1 / sqrt(3), one degree of freedom: 60 degrees
    assert found.points == 3


@pytest.mark.parametrize(("x", "y"), [([1.0, 2.0], [1.0, 2.0]), ([1.0, 1.0, 1.0], [1.0, 2.0, 3.0]), ([], [])])
def test_no_line(x, y):
    assert trend(x, y) is None
