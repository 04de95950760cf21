"""Options, steps and result of a relaxation of the soft tissue to the minimum of its energy (eq. 4.3 of [2])."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum
from numbers import Integral, Real
from typing import TYPE_CHECKING, Annotated, Literal

from warp_trunk.errors import InputError, expect

from .tissue import Limits

if TYPE_CHECKING:
    from .line_search import Trial

Method = Literal["newton", "gradient"]
ROUNDING = {"float32": 1e-7, "float64": 1e-14}
"""Relative change of the energy that the precision does not resolve."""
PATIENCE = 8
"""Estimates in a row that are no smaller, once the energy no longer resolves a step, before the loop gives up."""


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
    max_steps: int = 500
    """Most steps of one relaxation."""

    def __post_init__(self) -> None:
        if self.method not in ("newton", "gradient"):
            raise InputError(f"method: must be newton or gradient, not '{self.method}'")
        check_tolerance(self.tolerance)
        expect(self.max_steps, Integral, f"max_steps: {self.max_steps}", "give a whole number such as 500")
        if self.max_steps < 1:
            raise InputError(f"max_steps: must be at least 1, not {self.max_steps}")


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


class RelaxStatus(Enum):
    """Why a relaxation ended; the value is the sentence for the user."""

    CONVERGED = "the distance to equilibrium is below the tolerance"
    NEAR = "the distance to equilibrium is estimated to be below the tolerance, on the way to the next increment"
    STALLED = "the energy no longer falls, and the distance to equilibrium is not known to be below the tolerance"
    STOPPED = "the energy no longer falls along the gradient; the distance to equilibrium is only estimated"
    STEP_LIMIT = "the most steps allowed were taken before the tolerance was reached"
    NOT_FINITE = "the energy at the start is not a finite number; check the input and the size of the increment"

    def __str__(self) -> str:
        return self.name


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


@dataclass
class History:
    """The accepted steps of a relaxation that is not at its end."""

    energy: Energy
    """Energy now, by term."""
    inverted_tets: int
    """Tetrahedra without positive volume now."""
    relative_rounding: float
    """Relative change of the energy that the precision does not resolve."""
    start: float
    """When the relaxation began, by `time.perf_counter` [s]."""
    linear_iterations: int = 0
    """Iterations of the linear solver so far."""
    evaluations: int = 1
    """Evaluations of energy and gradient so far."""
    watch: Callable[[RelaxStep], None] | None = None
    """Called with every step, once its distance is known."""

    def __post_init__(self) -> None:
        self._history: list[RelaxStep] = []
        self._last: RelaxStep | None = None
        self._iterations = 0
        self._energies = [self.energy.total]
        self._least, self._waited = math.inf, 0

    @property
    def rounding(self) -> float:
        """Change of the energy that the precision does not resolve.

        It is relative to the largest energy so far: one near zero can be the sum of large parts, where tissue
        turns."""
        return self.relative_rounding * max(map(abs, self._energies))

    def largest_energy(self, steps: int) -> float:
        """The largest energy after the last steps."""
        return max(self._energies[-steps:])

    def add(self, trial: Trial) -> None:
        """Adds an accepted step, whose distance is not known yet."""
        self.energy, self.inverted_tets = trial.energy, trial.inverted
        self._energies.append(trial.energy.total)
        seconds = time.perf_counter() - self.start
        self._last = RelaxStep(trial.energy, math.inf, trial.length, self._iterations, seconds)

    def solved(self, estimated_error: float, iterations: int = 0) -> None:
        """Adds the distance of the state [mm] and the linear iterations that were spent on it."""
        self.linear_iterations += iterations
        self._iterations = iterations
        if self._last is not None:
            step, self._last = replace(self._last, estimated_error=estimated_error), None
            self._history.append(step)
            if self.watch is not None:
                self.watch(step)

    def falls(self, steps: int) -> bool:
        """Whether the energy has fallen by more than it rounds over the last steps."""
        return min(self._energies[:-steps], default=math.inf) - min(self._energies[-steps:]) > self.rounding

    def stagnated(self, estimated_error: float) -> bool:
        """Adds an estimate; returns whether neither the estimates nor the energy fall any more."""
        self._waited = 0 if estimated_error < 0.9 * self._least else self._waited + 1
        self._least = min(self._least, estimated_error)
        return self._waited >= PATIENCE and not self.falls(PATIENCE)

    def end(self, status: RelaxStatus, estimated_error: float) -> Relaxation:
        """How it ended."""
        self.solved(estimated_error)
        return Relaxation(
            status=status,
            energy=self.energy,
            steps=len(self._history),
            linear_iterations=self.linear_iterations,
            evaluations=self.evaluations,
            estimated_error=estimated_error,
            inverted_tets=self.inverted_tets,
            history=tuple(self._history),
        )
