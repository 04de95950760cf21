"""Numbers as text: two digits, sides in words, intervals."""

from __future__ import annotations

from .quantities import Measured, Quantity

MISSING = "–"
"""Stands where there is nothing to measure."""


def rounded(value: float) -> float:
    """A value with the digits that are shown: two, or all before the point."""
    return round(value, 0 if abs(value) >= 9.95 else 1)


def number(value: float | None, *, sign: bool = False) -> str:
    """A number with two digits, or all before the point, never -0; a dash where it is missing."""
    if value is None:
        return MISSING
    text = f"{value:{'+' if sign else ''}z.{0 if abs(value) >= 9.95 else 1}f}".replace("-", "−")
    return "0.0" if text == "+0.0" else text


def sided(value: float | None, unit: str = "") -> str:
    """A number that is positive to the right, with its side in words; a dash where it is missing."""
    if value is None:
        return MISSING
    size = number(abs(value))
    return size + unit if size == "0.0" else f"{size}{unit} {'right' if value > 0.0 else 'left'}"


def value_text(quantity: Quantity, value: float | None, unit: str = "") -> str:
    """A value of a quantity, with its side in words where it has one, and a unit after the number."""
    if value is None:
        return MISSING
    return sided(value, unit) if quantity.side else number(value) + unit


def interval_text(row: Measured | None, *, sided: bool) -> str:
    """Where a number lies in 19 of 20 cases, in whole units; empty where that is not known."""
    if row is None or row.low is None or row.high is None:
        return ""
    low, high = row.low, row.high
    if round(low) * round(high) >= 0 or not sided:
        ends = sorted((abs(low), abs(high))) if sided else [low, high]
        return f"{ends[0]:z.0f} to {ends[1]:z.0f}".replace("-", "−")
    return f"{abs(low):.0f} left to {high:.0f} right"
