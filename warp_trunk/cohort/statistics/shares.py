"""Shares of what lies within a limit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def share_within(errors: Sequence[float], limit: float) -> float | None:
    """The part of errors whose size is below a limit, from 0 to 1; None without errors."""
    return share_true([abs(error) < limit for error in errors])


def share_true(flags: Iterable[bool | None]) -> float | None:
    """The part that is true of what is known; None where nothing is."""
    known = [flag for flag in flags if flag is not None]
    return sum(known) / len(known) if known else None
