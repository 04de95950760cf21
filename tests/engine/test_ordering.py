"""Recursive bisection: a permutation in compact parts."""

from itertools import pairwise

import numpy as np
import pytest

from warp_trunk.engine.ordering import bisect

POINTS = np.random.default_rng(0).uniform(size=(1000, 3)) * [10.0, 3.0, 1.0]


@pytest.mark.parametrize(
    ("count", "parts"), [(1, 1), (2, 1), (2, 2), (3, 2), (3, 3), (17, 5), (17, 8), (1000, 3), (1000, 100)]
)
def test_order_is_a_permutation_in_equal_parts(count: int, parts: int) -> None:
    order, bounds = bisect(POINTS[:count], parts)
    assert sorted(order) == list(range(count))
    assert (bounds[0], bounds[-1], len(bounds)) == (0, count, parts + 1)
    sizes = np.diff(bounds)
    assert sizes.min() >= 1
    assert np.abs(sizes - count / parts).max() <= np.ceil(np.log2(max(parts, 2)))


def test_parts_are_compact() -> None:
    """Sixteen parts of a 10 x 3 x 1 box: each has less than a third of the spread of the whole."""
    order, bounds = bisect(POINTS, 16)
    spread = [np.linalg.norm(np.ptp(POINTS[order[a:b]], axis=0)) for a, b in pairwise(bounds)]
    assert max(spread) < np.linalg.norm(np.ptp(POINTS, axis=0)) / 3.0


def test_first_cut_is_across_the_longest_axis() -> None:
    order, bounds = bisect(POINTS, 2)
    low, high = POINTS[order[: bounds[1]], 0], POINTS[order[bounds[1] :], 0]
    assert low.max() <= high.min()


def test_equal_points_are_no_trouble() -> None:
    order, bounds = bisect(np.zeros((64, 3)), 8)
    assert sorted(order) == list(range(64))
    assert (np.diff(bounds) == 8).all()
