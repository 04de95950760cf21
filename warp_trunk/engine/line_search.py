"""How far to go along a direction."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from .relaxation import Energy
from .state import ProductReader, Products, State

DECREASE = 1e-4
"""Armijo: the part of the decrease that the slope promises which a step must give."""
MOST_TRIALS = 40
"""Halvings from a first length to one that moves nothing in float32."""


@dataclass(frozen=True)
class Trial:
    """A point along the direction, evaluated."""

    length: float
    """Fraction of the direction."""
    energy: Energy
    """Energy there."""
    inverted: int
    """Tetrahedra without positive volume there."""
    forbidden: int
    """Those of them that had one at the start of the search and must keep it."""
    products: Products
    """Products of the gradient there with the direction and the gradient at the start."""

    @classmethod
    def read(cls, length: float, state: State, products: ProductReader) -> Trial:
        """Reads what was evaluated at a length."""
        energy, inverted, newly_inverted = state.read()
        forbidden = 0 if state.model.elements.rights_inverted else newly_inverted
        return cls(length, energy, inverted, forbidden, products.read())

    @property
    def allowed(self) -> bool:
        """Finite, and no tetrahedron inverted that must not be."""
        return self.forbidden == 0 and math.isfinite(self.energy.total + self.products.slope)


def search(
    attempt: Callable[[float], Trial],
    length: float,
    reference: float,
    slope: float,
    slope_ratio: float | None = None,
    *,
    rounding: float = 1e-9,
) -> tuple[Trial | None, int]:
    """A length along a descent direction that lowers the energy and is allowed.

    Args:
        attempt: evaluates the point at a length.
        length: the first length to try.
        reference: the energy to come below: the last, or the largest of the last few.
        slope: derivative of the energy along the direction at its start, negative.
        slope_ratio: go on until the slope has fallen to this part of the first; None takes the first decrease.
        rounding: change of the energy below which the slopes decide.

    Returns:
        The trial, the last one attempted, or None where no length helps; and the number of attempts.
    """
    low, high, low_slope = 0.0, math.inf, slope
    best: Trial | None = None
    attempts = 0
    while attempts < MOST_TRIALS and (math.isinf(high) or high - low > 1e-6 * high):
        trial = attempt(length)
        attempts += 1
        good = trial.allowed and falls(trial, reference, slope, rounding)
        if good and (slope_ratio is None or abs(trial.products.slope) <= slope_ratio * abs(slope)):
            return trial, attempts
        if good and (best is None or trial.energy.total < best.energy.total):
            best = trial
        wanted = flat_length(trial, low, low_slope)
        if good and trial.products.slope < 0.0:
            low, low_slope = length, trial.products.slope
        else:
            high = length
        if math.isinf(high):
            length = min(max(wanted, 1.5 * length), 10.0 * length)
        else:
            length = min(max(wanted, 0.9 * low + 0.1 * high), 0.1 * low + 0.9 * high)
    return (attempt(best.length), attempts + 1) if best is not None else (None, attempts)


def falls(trial: Trial, reference: float, slope: float, rounding: float) -> bool:
    """Whether the energy falls enough; where its change is lost in rounding, whether the slope is flatter."""
    change = trial.energy.total - reference
    flatter = abs(trial.products.slope) <= (1.0 - 2.0 * DECREASE) * abs(slope)
    return change <= DECREASE * trial.length * slope or (change <= rounding and flatter)


def flat_length(trial: Trial, low: float, low_slope: float) -> float:
    """Where the slope is zero by the secant through `low` and the trial; halfway back from a trial not allowed."""
    if not trial.allowed:
        return 0.5 * (low + trial.length)
    bend = trial.products.slope - low_slope
    return low - low_slope * (trial.length - low) / bend if bend > 0.0 else math.inf
