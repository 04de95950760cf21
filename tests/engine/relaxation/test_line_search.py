"""The line search on functions of one variable."""

import math
from collections.abc import Callable

import pytest

from warp_trunk.engine.line_search import Trial, search
from warp_trunk.engine.relaxation import Energy
from warp_trunk.engine.state import Products


def trial(length: float, energy: float, slope: float, forbidden: int = 0) -> Trial:
    products = Products(slope, 0.0, 1.0)
    return Trial(length, Energy({"distance": energy}), forbidden, forbidden, products)


def along(
    energy: Callable[[float], float], slope: Callable[[float], float], inverted_beyond: float = math.inf
) -> tuple[Callable[[float], Trial], list[float]]:
    """An `attempt` on a function of the length, and the lengths it was asked for."""
    tried: list[float] = []

    def attempt(length: float) -> Trial:
        tried.append(length)
        return trial(length, energy(length), slope(length), int(length > inverted_beyond))

    return attempt, tried


def test_takes_the_first_decrease() -> None:
    attempt, tried = along(lambda x: (x - 3.0) ** 2, lambda x: 2.0 * (x - 3.0))
    found, _ = search(attempt, 1.0, 9.0, -6.0)
    assert found is not None
    assert found.length == 1.0
    assert tried == [1.0]


@pytest.mark.parametrize("first", [8.0, 1e6])
def test_comes_back_from_beyond_the_valley(first: float) -> None:
    attempt, _ = along(lambda x: (x - 3.0) ** 2, lambda x: 2.0 * (x - 3.0))
    found, _ = search(attempt, first, 9.0, -6.0)
    assert found is not None
    assert 0.0 < found.length < 6.0


def test_never_ends_where_a_tetrahedron_would_invert() -> None:
    attempt, _ = along(lambda x: (x - 3.0) ** 2, lambda x: 2.0 * (x - 3.0), inverted_beyond=0.7)
    found, _ = search(attempt, 5.0, 9.0, -6.0)
    assert found is not None
    assert 0.0 < found.length <= 0.7


def test_comes_back_from_numbers_that_are_not_finite() -> None:
    attempt, _ = along(lambda x: (x - 3.0) ** 2 if x < 4.0 else math.nan, lambda x: 2.0 * (x - 3.0))
    found, _ = search(attempt, 64.0, 9.0, -6.0)
    assert found is not None
    assert found.energy.total < 9.0


def test_gives_up_where_nothing_falls() -> None:
    attempt, tried = along(lambda x: 9.0 + x, lambda x: 1.0)
    found, attempts = search(attempt, 1.0, 9.0, -6.0)
    assert found is None
    assert attempts == len(tried) < 100
