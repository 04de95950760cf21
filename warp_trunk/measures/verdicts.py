"""Rules for statements about numbers: whether one is known, how two compare, and whether a change can be seen.

Tables, tiles, sentences, pictures, the planning page and the recording read these rules.
"""

from __future__ import annotations

from typing import Literal

from .number_text import number, rounded
from .quantities import Measured, Quantity

Verdict = Literal["visibly better", "no visible change", "visibly worse", "other side", "not known"]
"""One word for a number that should be small: its change against what can be detected and against its interval."""
NOT_KNOWN: Verdict = "not known"
"""Stands in place of a number whose interval is wider than what it says."""


def is_known(quantity: Quantity, row: Measured | None, before: float | None = None) -> bool:
    """Whether a number says more than its interval is wide.

    It says how large it is and how far it is from the number before surgery: half of its interval must not be more
    than the larger of both, or than what can be detected. Without an interval it is taken as it is.
    """
    if row is None or row.value is None:
        return False
    if row.low is None or row.high is None:
        return True
    change = 0.0 if before is None else abs(row.value - before)
    return 0.5 * (row.high - row.low) <= max(abs(row.value), change, quantity.detectable)


def verdict(quantity: Quantity, before: float | None, row: Measured | None) -> Verdict | None:
    """How a number that should be small changes, in one word; None for any other number.

    A change is visible from `Quantity.detectable` on, and certain where the interval of the number's size leaves
    out the size before. What is visible but not certain is not known, nor is what may be visibly better as well as
    visibly worse. A number that is seen on the other side afterwards, about as large as before, has changed its
    side.
    """
    if not quantity.should_be_small:
        return None
    if before is None or row is None or row.value is None or not is_known(quantity, row, before):
        return NOT_KNOWN
    size, least = abs(before), quantity.detectable
    more = abs(row.value) - size
    low, high = _sizes(row)
    if abs(more) >= least:
        certain = size > high if more < 0.0 else size < low
        if not certain and (row.low is not None and row.high is not None):
            return NOT_KNOWN
        return "visibly better" if more < 0.0 else "visibly worse"
    if low <= size - least and high >= size + least:
        return NOT_KNOWN
    if before * row.value < 0.0 and abs(row.value - before) >= least:
        return "other side"
    return "no visible change"


def is_certainly_worse(quantity: Quantity, before: float | None, row: Measured | None) -> bool:
    """Whether a number is visibly worse, and its interval says so: what pages mark."""
    return row is not None and row.low is not None and verdict(quantity, before, row) == "visibly worse"


def _sizes(row: Measured) -> tuple[float, float]:
    """The interval of the size of a number; the size itself where there is none."""
    ends = [abs(end) for end in (row.low, row.high, row.value) if end is not None]
    both = row.low is not None and row.high is not None and row.low < 0.0 < row.high
    return (0.0 if both else min(ends)), max(ends)


def change_text(quantity: Quantity, before: float | None, after: float | None) -> str:
    """The difference of two numbers as they are shown, as a size with a word: better or worse, other side (then it
    is the whole way), or more or less where neither is better; a dash where one is missing."""
    if before is None or after is None:
        return number(None)
    was, will = rounded(before), rounded(after)
    if quantity.should_be_small and was * will < 0.0:
        return f"{number(abs(will - was))}, other side"
    more = abs(will) - abs(was) if quantity.should_be_small else will - was
    size = number(abs(more))
    if size == "0.0":
        return size
    return f"{size} {difference_word(quantity, more)}"


def difference_word(quantity: Quantity, more: float) -> str:
    """The word beside a difference of sizes, of a number that is larger by `more`."""
    larger, smaller = ("worse", "better") if quantity.should_be_small else ("more", "less")
    return larger if more > 0.0 else smaller
