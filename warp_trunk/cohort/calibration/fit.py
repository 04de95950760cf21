"""Least squares over cases with priors, and how sure what it finds is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

CONFIDENCE = 0.95
MOST_EVALUATIONS = 12
"""Rounds over all cases; four to six are usual."""
LEAST_STEP = 2e-3
"""A step smaller than this part of what is believed of each constant ends the search."""

Piece = tuple[np.ndarray, np.ndarray]
"""Residuals (n,) and their derivative (n, constants) of one patient."""
Evaluate = Callable[[np.ndarray], Mapping[str, Piece]]
"""From constants as they are counted to the pieces of all patients; called twice at some places."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Prior:
    """The prior of the constants, in the scale in which they are fitted; each shape (constants,)."""

    mean: np.ndarray
    """Their middle."""
    sd: np.ndarray
    """Their standard deviation."""
    low: np.ndarray
    """The least they can be."""
    high: np.ndarray
    """The most."""
    weight: float = 1.0
    """How much it counts; 0 leaves it out but for the limits."""

    @property
    def information(self) -> np.ndarray:
        """Its second derivative, shape (constants, constants)."""
        return self.weight * np.diag(self.sd**-2.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Fit:
    """The result of a fit."""

    counted: np.ndarray
    """The constants as they are counted, shape (constants,)."""
    pieces: Mapping[str, Piece]
    """Residuals and derivatives there, by patient."""
    converged: bool
    """Whether the search came to its end."""


def find(evaluate: Evaluate, prior: Prior) -> Fit:
    """The constants that fit all patients best (SciPy's trust region), with what is believed of them."""
    from scipy.optimize import least_squares  # heavy

    root = np.sqrt(prior.weight) / prior.sd

    def residuals(x: np.ndarray) -> np.ndarray:
        return np.concatenate([*(r for r, _ in evaluate(x).values()), root * (x - prior.mean)])

    def derivative(x: np.ndarray) -> np.ndarray:
        return np.concatenate([*(j for _, j in evaluate(x).values()), np.diag(root)])

    solve: Any = least_squares  # its types know no function for a derivative
    solution = solve(
        residuals,
        np.clip(prior.mean, prior.low, prior.high),
        derivative,
        bounds=(prior.low, prior.high),
        x_scale=prior.sd,
        xtol=LEAST_STEP,
        ftol=1e-5,
        gtol=None,
        max_nfev=MOST_EVALUATIONS,
    )
    return Fit(counted=solution.x, pieces=evaluate(solution.x), converged=solution.status > 0)


@dataclass(frozen=True, eq=False)
class Certainty:
    """How sure the constants are, as they are counted."""

    covariance: np.ndarray
    """Shape (constants, constants)."""
    width: float
    """Standard deviations to either side that hold 95 %."""
    from_data: np.ndarray
    """Fraction of the information about each that comes from the patients, from 0 (only the prior) to 1, shape
    (constants,)."""

    @property
    def sd(self) -> np.ndarray:
        """Standard error of each, shape (constants,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> np.ndarray:
        """Between each two, shape (constants, constants)."""
        return self.covariance / np.outer(self.sd, self.sd)


def certainty(pieces: Mapping[str, Piece], prior: Prior) -> Certainty:
    """Standard errors of constants found by least squares.

    A^-1 B A^-1 with the second derivative A and the spread B of the gradients of patients about their mean (Huber
    and White, patients as clusters): places of one skin err alike, so that only patients count as independent.
    Where there are too few of them, or the spread says less than the stated errors do, A^-1 stands.
    """
    from scipy.stats import norm, t  # heavy

    gradients = np.array([j.T @ r for r, j in pieces.values()])
    A = sum((j.T @ j for _, j in pieces.values()), start=prior.information.copy())
    inverse = np.linalg.inv(A)
    patients = len(gradients)
    covariance, width = inverse, float(norm.ppf(0.5 + 0.5 * CONFIDENCE))
    if patients > len(A):
        away = gradients - gradients.mean(axis=0)
        B = patients / (patients - 1.0) * away.T @ away + prior.information
        robust = inverse @ B @ inverse
        wider = np.sqrt(np.maximum(np.diag(robust) / np.diag(inverse), 1.0))
        correlation = robust / np.sqrt(np.outer(np.diag(robust), np.diag(robust)))
        sd = wider * np.sqrt(np.diag(inverse))
        covariance, width = np.outer(sd, sd) * correlation, float(t.ppf(0.5 + 0.5 * CONFIDENCE, patients - 1))
    return Certainty(covariance, width, from_data=1.0 - np.diag(inverse @ prior.information))


def without(pieces: Mapping[str, Piece], left_out: str, at: np.ndarray, prior: Prior) -> np.ndarray:
    """The constants without one patient: one step of least squares from those that fit all.

    Near the fit the problem is nearly linear, and the step goes nearly all of the way.

    Args:
        pieces: residuals and derivatives of all patients at the fit.
        left_out: the patient to leave out.
        at: the constants that fit all.
        prior: what is believed of them.
    """
    rest: Sequence[Piece] = [piece for patient, piece in pieces.items() if patient != left_out]
    A = sum((j.T @ j for _, j in rest), start=prior.information.copy())
    gradient = sum((j.T @ r for r, j in rest), start=prior.information @ (at - prior.mean))
    return np.clip(at - np.linalg.solve(A, gradient), prior.low, prior.high)
