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
"""Lengths that are tried: halvings to one that moves nothing in float32."""


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
    *,
    rounding: float = 1e-9,
    most: int = MOST_TRIALS,
) -> Trial | None:
    """A length along a descent direction that lowers the energy and is allowed.

    Args:
        attempt: evaluates the point at a length.
        length: the first length to try.
        reference: the energy to come below: the last, or the largest of the last few.
        slope: derivative of the energy along the direction at its start, negative.
        rounding: change of the energy below which the slopes decide.
        most: lengths to try.

    Returns:
        The trial, the last one attempted, or None where no length helps.
    """
    for _ in range(most):
        trial = attempt(length)
        if trial.allowed and falls(trial, reference, slope, rounding):
            return trial
        length = min(max(flat_length(trial, slope), 0.1 * length), 0.9 * length)
    return None


def falls(trial: Trial, reference: float, slope: float, rounding: float) -> bool:
    """Whether the energy falls enough; where its change is lost in rounding, whether the slope is flatter."""
    change = trial.energy.total - reference
    flatter = abs(trial.products.slope) <= (1.0 - 2.0 * DECREASE) * abs(slope)
    return change <= DECREASE * trial.length * slope or (change <= rounding and flatter)


def flat_length(trial: Trial, slope: float) -> float:
    """Where the slope is zero by the secant through the start and the trial; halfway back from one not allowed."""
    if not trial.allowed:
        return 0.5 * trial.length
    bend = trial.products.slope - slope
    return -slope * trial.length / bend if bend > 0.0 else math.inf
