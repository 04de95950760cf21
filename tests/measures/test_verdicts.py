"""The words about numbers: from the change that can be detected, and from the interval."""

import pytest

from warp_trunk.measures.quantities import QUANTITIES, Measured
from warp_trunk.measures.verdicts import change_text, is_certainly_worse, is_known, verdict

SHOULDERS, HEIGHT = QUANTITIES["shoulder_difference_mm"], QUANTITIES["spine_height_mm"]
"""Detectable are 5 mm."""


def row(value: float | None, low: float | None = None, high: float | None = None) -> Measured:
    return Measured("predicted", "", "shoulder_difference_mm", value, low, high)


@pytest.mark.parametrize(
    ("before", "after", "word"),
    [
        (20.0, row(8.0, 4.0, 12.0), "visibly better"),
        (-20.0, row(-8.0, -12.0, -4.0), "visibly better"),
        (20.0, row(8.0, -4.0, 20.5), "not known"),  # may be no better
        (20.0, row(8.0, -21.0, 37.0), "not known"),  # may be as large on the left
        (8.0, row(20.0, 12.0, 28.0), "visibly worse"),
        (8.0, row(20.0, 7.0, 33.0), "not known"),
        (8.0, row(9.0, 5.0, 13.5), "no visible change"),  # may be visibly worse, and not visibly better
        (8.0, row(9.0, 2.5, 15.5), "not known"),  # may be either
        (8.0, row(4.0, -7.0, 15.0), "not known"),  # says less than its interval is wide
        (8.0, row(-7.0, -12.0, -2.0), "other side"),
        (2.0, row(-1.5, -3.0, 0.0), "no visible change"),  # on the other side, and not to be seen
        (20.0, row(8.0), "visibly better"),  # no interval
        (20.0, row(None), "not known"),
        (None, row(8.0), "not known"),
    ],
)
def test_every_headline_has_one_word(before: float | None, after: Measured, word: str) -> None:
    assert verdict(SHOULDERS, before, after) == word
    assert is_certainly_worse(SHOULDERS, before, after) == (word == "visibly worse")
    assert verdict(HEIGHT, before, after) is None


def test_what_is_worse_without_an_interval_is_not_certain() -> None:
    assert verdict(SHOULDERS, 8.0, row(20.0)) == "visibly worse"
    assert not is_certainly_worse(SHOULDERS, 8.0, row(20.0))


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        (9.0, row(9.0, 0.5, 17.5), True),
        (9.0, row(6.0, -2.0, 14.0), False),
        (20.0, row(6.0, -2.0, 14.0), True),  # 14 less than before
        (0.0, row(0.5, -4.0, 5.0), True),  # within what can be detected
        (9.0, row(6.0), True),
        (9.0, row(None), False),
    ],
)
def test_a_number_is_known_where_it_says_more_than_its_interval_is_wide(
    before: float, after: Measured, expected: bool
) -> None:
    assert is_known(SHOULDERS, after, before) == expected


def test_differences_are_sizes_whatever_their_side() -> None:
    assert change_text(SHOULDERS, -14.0, -9.0) == change_text(SHOULDERS, 14.0, 9.0) == "5.0 better"
    assert change_text(SHOULDERS, 5.5, -4.7) == "10, other side"
    assert change_text(SHOULDERS, 5.02, 5.04) == "0.0"
    assert change_text(HEIGHT, 400.0, 391.0) == "9.0 less"
    assert change_text(HEIGHT, None, 391.0) == "–"
