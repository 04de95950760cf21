"""Errors of one case by range of levels, of the prediction and of what any method must beat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from warp_trunk.measures.comparison import RANGES, BsrError, bsr_error

from .record import CaseRow

Guess = Literal["predicted", "before", "spline"]
"""The guess that is compared with the actual skin: the prediction, "nothing changes", or "the spline carries
the skin"."""


@dataclass(frozen=True)
class LevelError:
    """One level of one case."""

    case: CaseRow
    """The case."""
    level: str
    """The vertebra."""
    guessed: float
    """The guess [degrees]."""
    actual: float
    """Actual rotation [degrees]."""
    in_band: bool | None
    """Whether the actual rotation lies in the band of the prediction."""

    @property
    def error(self) -> float:
        """Guessed less actual [degrees]."""
        return self.guessed - self.actual


def level_errors(rows: Sequence[CaseRow], of: str, guess: Guess = "predicted") -> list[LevelError]:
    """The errors of cases at the levels of a range of `RANGES` where all three guesses and the actual are known.

    Only those are taken, so that guesses are compared at the same places.
    """
    return [
        LevelError(row, level.level, getattr(level, guess), level.actual, level.in_band)
        for row in rows
        for level in row.levels
        if level.level in RANGES[of]
        and level.actual is not None
        and None not in (level.predicted, level.before, level.spline)
    ]


def case_error(row: CaseRow, of: str, guess: Guess = "predicted") -> BsrError | None:
    """The error of a case over a range as the papers give it: mean absolute and its standard deviation."""
    known = {one.level: (one.guessed, one.actual) for one in level_errors([row], of, guess)}
    return bsr_error(known, RANGES[of])
