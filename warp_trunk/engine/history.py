"""The accepted steps of a relaxation that is not at its end, and whether they still lead on."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace

from .line_search import Trial
from .relaxation import Energy, Relaxation, RelaxStatus, RelaxStep
from .state import State

ROUNDING = {"float32": 1e-7, "float64": 1e-14}
"""Relative change of the energy that the precision does not resolve."""
PATIENCE = 8
"""Estimates in a row that are no smaller, once the energy no longer resolves a step, before the loop gives up."""


class History:
    """The accepted steps of a relaxation that is not at its end."""

    energy: Energy
    """Energy now, by term."""
    inverted_tets: int
    """Tetrahedra without positive volume now."""
    linear_iterations: int
    """Iterations of the linear solver so far."""
    evaluations: int
    """Evaluations of energy and gradient so far."""

    def __init__(self, state: State, start: float, watch: Callable[[RelaxStep, State], None] | None) -> None:
        """Reads the state, which was evaluated.

        Args:
            state: the one that is relaxed.
            start: when the relaxation began, by `time.perf_counter` [s].
            watch: called with every step, once its distance is known, and the state.
        """
        self.energy, self.inverted_tets, _ = state.read()
        self.linear_iterations, self.evaluations = 0, 1
        self._state, self._start, self._watch = state, start, watch
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
        return ROUNDING[self._state.model.precision] * max(map(abs, self._energies))

    def largest_energy(self, steps: int) -> float:
        """The largest energy after the last steps."""
        return max(self._energies[-steps:])

    def add(self, trial: Trial) -> None:
        """Adds an accepted step, whose distance is not known yet."""
        self.energy, self.inverted_tets = trial.energy, trial.inverted
        self._energies.append(trial.energy.total)
        seconds = time.perf_counter() - self._start
        self._last = RelaxStep(trial.energy, math.inf, trial.length, self._iterations, seconds)

    def solved(self, estimated_error: float, iterations: int = 0) -> None:
        """Adds the distance of the state [mm] and the linear iterations that were spent on it."""
        self.linear_iterations += iterations
        self._iterations = iterations
        if self._last is not None:
            step, self._last = replace(self._last, estimated_error=estimated_error), None
            self._history.append(step)
            if self._watch is not None:
                self._state.show(self._watch, step)

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
