"""Whether one number goes with another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

LEAST = 3
"""Fewer points have no trend."""


@dataclass(frozen=True, kw_only=True)
class Trend:
    """A straight line through points, and how well it fits."""

    slope: float
    """Change of the second number with the first."""
    intercept: float
    """The second number where the first is 0."""
    correlation: float
    """Pearson's, from -1 to 1."""
    p: float
    """How likely points without a trend give at least this correlation (two-sided, t test)."""
    points: int
    """How many points."""


def trend(x: Sequence[float | None], y: Sequence[float | None]) -> Trend | None:
    """The line of least squares through the points that have both numbers.

    Returns:
        The line; None for fewer than three points, or where either number never changes.
    """
    known = np.array([(a, b) for a, b in zip(x, y, strict=True) if a is not None and b is not None], dtype=float)
    if len(known) < LEAST or (np.ptp(known, axis=0) == 0.0).any():
        return None
    from scipy.stats import linregress  # heavy

    line: Any = linregress(known[:, 0], known[:, 1])
    return Trend(
        slope=float(line.slope),
        intercept=float(line.intercept),
        correlation=float(line.rvalue),
        p=float(line.pvalue),
        points=len(known),
    )
