"""Options, steps and result of a relaxation of the soft tissue to the minimum of its energy (eq. 4.3 of [2])."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from numbers import Real
from typing import Annotated, Literal

from warp_trunk.checking import check_fields
from warp_trunk.errors import InputError

from .tissue import Limits

Method = Literal["newton", "gradient"]
ON_THE_WAY = 20.0
"""Tolerances to which increments on the way are relaxed, by an estimate that is pessimistic: at the default of
0.1 mm no node was farther than 0.9 mm from its equilibrium then, and none of the skin 0.05 mm."""


@dataclass(frozen=True, kw_only=True)
class RelaxOptions:
    """How far and by which method the tissue is relaxed.

    >>> wt.RelaxOptions(tolerance=0.05).method
    'newton'
    """

    method: Method = "newton"
    """newton (truncated Newton, to the tolerance), or gradient (the papers' projected gradient, which ends where
    the energy no longer falls; the tolerance has no effect on it)."""
    tolerance: Annotated[float, Limits(description="mm")] = 0.1
    """Largest estimated distance of a node from its equilibrium at the end [mm]. The mesh is worth 0.3 to 0.7 mm,
    and at 0.1 mm no rotation of the back moves by 0.00001 degrees; benchmarks of the solver take 0.01."""
    max_steps: Annotated[int, Limits(ge=1, le=1e9)] = 500
    """Most steps of one relaxation."""

    def __post_init__(self) -> None:
        check_fields(self, "relaxation")
        check_tolerance(self.tolerance)


def check_tolerance(tolerance: float) -> None:
    """InputError where it is no positive number of mm."""
    if not (isinstance(tolerance, Real) and math.isfinite(tolerance) and tolerance > 0.0):
        raise InputError(f"tolerance: must be a positive number of mm, not {tolerance!r}; give 0.1, for example")


@dataclass(frozen=True)
class Energy:
    """The terms of an energy, each with its factor, in the energy's unit."""

    terms: dict[str, float]
    """By name, those that the scene uses. itmsm, eq. 4.6 of [2], has `distance` (edges), `area` (faces, with
    epsilon) and `volume` (with theta), the neo-Hookean energy `volume` (lambda / 2 (J - 1)^2) and `shape` (the
    terms in mu); both have `gravity`, of heights above the lowest node at rest, with the sign of physics, and
    `bending` of the skin."""

    @property
    def total(self) -> float:
        """Their sum, which the relaxation makes least."""
        return sum(self.terms.values())


class RelaxStatus(StrEnum):
    """Why a relaxation ended: a name, which files keep, with its sentence for the user."""

    sentence: str
    """A sentence without its end."""

    CONVERGED = "CONVERGED", "the distance to equilibrium is below the tolerance"
    NEAR = (
        "NEAR",
        "the distance to equilibrium is estimated to be below the tolerance, on the way to the next increment",
    )
    STALLED = (
        "STALLED",
        "the energy no longer falls, and the distance to equilibrium is not known to be below the tolerance",
    )
    STOPPED = (
        "STOPPED",
        "the energy no longer falls along the gradient; the distance to equilibrium is only estimated",
    )
    STEP_LIMIT = "STEP_LIMIT", "the most steps allowed were taken before the tolerance was reached"
    NOT_FINITE = (
        "NOT_FINITE",
        "the energy at the start is not a finite number; check the input and the size of the increment",
    )

    def __new__(cls, name: str, sentence: str) -> RelaxStatus:
        status = str.__new__(cls, name)
        status._value_, status.sentence = name, sentence
        return status


@dataclass(frozen=True)
class RelaxStep:
    """One accepted step."""

    energy: Energy
    """Energy after it, by term."""
    estimated_error: float
    """Estimated largest distance of a node from its equilibrium after it [mm], by the solve that began there, or
    how the relaxation ended; infinite if unknown."""
    step_length: float
    """Fraction of the proposed direction that was taken."""
    linear_iterations: int
    """Iterations of the linear solver spent on it."""
    seconds: float = field(compare=False)
    """Time from the start of the relaxation to its end [s]; steps that differ only in it are equal."""


@dataclass(frozen=True)
class Relaxation:
    """How a relaxation ended."""

    status: RelaxStatus
    """Why it ended."""
    energy: Energy
    """Energy at the end, by term."""
    steps: int
    """Accepted steps."""
    linear_iterations: int
    """Iterations of the linear solver in all."""
    evaluations: int
    """Evaluations of energy and gradient."""
    estimated_error: float
    """Largest distance of a node from its equilibrium at the end [mm]: certified if CONVERGED, an estimate if NEAR
    or STOPPED, infinite with the other statuses, by either method: they claim nothing."""
    inverted_tets: int
    """Tetrahedra without positive volume at the end."""
    history: tuple[RelaxStep, ...] = ()
    """Every accepted step in order."""
