"""How a linear solve ended."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Outcome(Enum):
    """Why a linear solve ended."""

    SOLVED = "no vector is estimated to be wrong by more than was asked for"
    NEGATIVE_CURVATURE = "a search direction of negative curvature was met; `search` holds it"
    EXHAUSTED = "the bound of iterations was reached, so that the error is not known"
    UNSOUND = "a vector is not finite, or rounding has made the preconditioner indefinite"


@dataclass(frozen=True)
class LinearSolution:
    """How a linear solve ended."""

    outcome: Outcome
    """Why."""
    iterations: int
    """Products with the matrix."""
    length: float
    """Length of the solution's longest vector [mm]; not finite where a vector is not."""
    error: float
    """Estimated error of a vector [mm], from how the changes from one test to the next shrank."""
    gradient_norm: float
    """The square root of g . M^-1 g [root of the energy's unit]."""
    residual_norm: float
    """The same of the residual that the solve left [root of the energy's unit]."""
