"""Limits of agreement, where each patient gives several pairs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

LIMIT = 1.96
"""Standard deviations to either side that hold 95 % of differences."""


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """How far predicted numbers lie from actual ones."""

    bias: float
    """Mean difference, predicted less actual."""
    sd: float | None
    """Standard deviation of a single difference, of patients and within them; None for one pair."""
    low: float | None
    """Where the interval begins that holds 95 % of differences ..."""
    high: float | None
    """... and where it ends."""
    pairs: int
    """How many pairs."""
    patients: int
    """Of how many patients."""


def limits_of_agreement(differences: Sequence[float], patients: Sequence[str]) -> Agreement | None:
    """Limits of agreement by Bland and Altman, for several pairs of a patient whose true value varies.

    The variance of a difference is that within patients (mean square of a one-way analysis) and that of patients,
    added; with one pair each it is the plain variance (Bland and Altman 2007, J Biopharm Stat 17:571, section 3).

    Args:
        differences: predicted less actual.
        patients: whose each pair is.

    Returns:
        The limits; None without differences.
    """
    d = np.asarray(differences, dtype=np.float64)
    if not len(d):
        return None
    _, whose = np.unique(np.asarray(patients), return_inverse=True)
    variance = _variance(d, whose)
    bias = float(d.mean())
    sd = None if variance is None else math.sqrt(variance)
    return Agreement(
        bias=bias,
        sd=sd,
        low=None if sd is None else bias - LIMIT * sd,
        high=None if sd is None else bias + LIMIT * sd,
        pairs=len(d),
        patients=int(whose.max()) + 1,
    )


def _variance(d: np.ndarray, whose: np.ndarray) -> float | None:
    """The variance of one difference; None where there is but one."""
    counts = np.bincount(whose)
    patients, pairs = len(counts), len(d)
    if pairs < 2:
        return None
    if patients in (1, pairs):  # no two variances to separate
        return float(d.var(ddof=1))
    means = np.bincount(whose, d) / counts
    within = float(((d - means[whose]) ** 2).sum()) / (pairs - patients)
    between = float((counts * (means - d.mean()) ** 2).sum()) / (patients - 1)
    typical = (pairs - float((counts**2).sum()) / pairs) / (patients - 1)
    return within + max(0.0, (between - within) / typical)
