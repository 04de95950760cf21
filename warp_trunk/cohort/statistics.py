"""Statistics of numbers from several patients; the functions know numbers and patients, not trunks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

DRAWS = 10_000
"""Draws of a bootstrap; the ends of its interval then vary by about 1 % of its width."""
SEED = 1
"""Of the draws: the same patients give the same interval."""


@dataclass(frozen=True)
class PatientMean:
    """A mean over patients."""

    mean: float
    """The mean of the patients' values."""
    sd: float | None
    """Their standard deviation (of a sample, n - 1); None for one patient."""
    low: float | None
    """Where the interval begins that holds the mean of all patients in 19 of 20 studies ..."""
    high: float | None
    """... and where it ends; None below three patients."""
    patients: int
    """How many patients."""


def over_patients(values: Sequence[float], patients: Sequence[str]) -> PatientMean | None:
    """The mean of values over patients, each patient counting once, with a bootstrap over patients.

    Values of one patient are averaged first: her levels and cases are correlated, so only patients are
    drawn (percentile interval of `scipy.stats.bootstrap`). With few patients it is too narrow, by a tenth to a
    quarter for six.

    Args:
        values: numbers.
        patients: whose each is.

    Returns:
        The estimate; None without values.
    """
    of: dict[str, list[float]] = {}
    for value, patient in zip(values, patients, strict=True):
        of.setdefault(patient, []).append(value)
    if not of:
        return None
    means = np.array([np.mean(values_of_patient) for values_of_patient in of.values()])
    low = high = None
    if len(means) >= 3:
        from scipy.stats import bootstrap  # heavy

        drawn = bootstrap(
            (means,), np.mean, n_resamples=DRAWS, method="percentile", rng=np.random.default_rng(SEED)
        ).confidence_interval
        low, high = float(drawn.low), float(drawn.high)
    sd = float(means.std(ddof=1)) if len(means) > 1 else None
    return PatientMean(float(means.mean()), sd, low, high, len(means))


LIMIT = 1.96
"""Standard deviations to either side that hold 95 % of differences."""


@dataclass(frozen=True)
class LimitsOfAgreement:
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


def limits_of_agreement(differences: Sequence[float], patients: Sequence[str]) -> LimitsOfAgreement | None:
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
    counts, bias, sd = np.bincount(whose), float(d.mean()), None
    pairs, people = len(d), len(counts)
    if pairs > 1:
        variance = float(d.var(ddof=1))
        if 1 < people < pairs:  # else there are no two variances to separate
            means = np.bincount(whose, d) / counts
            within = float(((d - means[whose]) ** 2).sum()) / (pairs - people)
            between = float((counts * (means - bias) ** 2).sum()) / (people - 1)
            typical = (pairs - float((counts**2).sum()) / pairs) / (people - 1)
            variance = within + max(0.0, (between - within) / typical)
        sd = math.sqrt(variance)
    low, high = (None if sd is None else bias + side * LIMIT * sd for side in (-1.0, 1.0))
    return LimitsOfAgreement(bias, sd, low, high, pairs, people)


LEAST_POINTS = 3
"""Fewer points have no trend."""


@dataclass(frozen=True)
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


def trend(x: Sequence[float | None], y: Sequence[float | None], least: int = LEAST_POINTS) -> Trend | None:
    """The line of least squares through the points that have both numbers.

    Returns:
        The line; None for fewer than `least` points, or where either number never changes.
    """
    points = np.array([(a, b) for a, b in zip(x, y, strict=True) if a is not None and b is not None], dtype=float)
    if len(points) < least or (np.ptp(points, axis=0) == 0.0).any():
        return None
    from scipy.stats import linregress  # heavy

    line: Any = linregress(points[:, 0], points[:, 1])
    return Trend(*map(float, (line.slope, line.intercept, line.rvalue, line.pvalue)), points=len(points))
