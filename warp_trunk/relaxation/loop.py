"""The projected loop: gradient, direction, line search, projection; it stops in mm or says why not.

Projection is the layout of the arrays: free nodes come first and every launch of the loop ends before the
prescribed ones, so a node on bone never moves by a bit (the mappings U of eq. 4.3 of [2]).
"""

from __future__ import annotations

import math

import warp as wp

from warp_trunk.kernels.loop import loop_kernels

from ..energy import Energy, State
from ..model import Model
from .conjugate import Conjugate
from .gradient import Gradient
from .line_search import Trial, search
from .linear import LinearSystem
from .newton import Newton
from .outcome import Relaxation, RelaxOptions, RelaxStatus, RelaxStep
from .products import ProductReader, Products

SAFETY = 1.5
"""Factor on the length of a truncated Newton step, which sees a little less than the whole distance."""
PATIENCE = 8
"""Estimates in a row that are no smaller, once the energy no longer resolves a step, before the loop gives up."""


class Relaxer:
    """Everything a relaxation needs on the device, made once for a model with free nodes."""

    state: State
    """The configuration now: set it, relax it, read it."""

    def __init__(self, model: Model, options: RelaxOptions | None = None) -> None:
        self.model = model
        self.options = options or RelaxOptions()
        states = State.pair(model)
        self.state, self._other = states
        self._newton = Newton(LinearSystem(model, self.state))
        methods = {"newton": lambda _: self._newton, "conjugate": Conjugate, "gradient": Gradient}
        self._method: Newton | Conjugate | Gradient = methods[self.options.method](model)
        self._reader = ProductReader(model, states, self._method.direction)
        self._newton_reader = ProductReader(model, states, self._newton.direction)
        self._length = model.array(None, wp.float64, (1,))
        self._step = {
            start: model.parallel.record(
                loop_kernels(model.scalar).step,
                model.free,
                [self._length, start.displacement, self._method.direction],
                [end.displacement],
            )
            for start, end in (states, states[::-1])
        }

    def relax(self, tolerance: float | None = None) -> Relaxation:
        """Relaxes `state` until the estimated distance to equilibrium is below the tolerance [mm].

        The energy falls at every accepted step (over ten for `gradient`), no tetrahedron is inverted
        that was not inverted at the start, and the number of steps is bounded.
        """
        tolerance = self.options.tolerance if tolerance is None else tolerance
        wp.copy(self._other.displacement, self.state.displacement)
        self.state.evaluate()
        energy, inverted, _ = self.state.read()
        self._reader.read(self.state)
        history: list[RelaxStep] = []
        linear_iterations, evaluations = 0, 1
        estimate = math.inf

        def report(status: RelaxStatus) -> Relaxation:
            return Relaxation(
                status, energy, len(history), linear_iterations, evaluations, estimate, inverted, history
            )

        if not math.isfinite(energy.total):
            return report(RelaxStatus.NOT_FINITE)
        energies = [energy.total]
        products: Products | None = None
        length, distance, waited = 0.0, math.inf, 0
        for step in range(self.options.max_steps):
            length, spent = self._method.propose(self.state, products, length)
            if self._method is self._newton:
                last, distance = distance, self._reader.longest()
                estimate = SAFETY * distance
                waited = 0 if distance < 0.9 * last else waited + 1
            elif step % self._method.estimates_every == 0:
                spent += self._newton.propose(self.state, None, 1.0)[1]
                estimate = SAFETY * self._newton_reader.longest()
            linear_iterations += spent
            if estimate <= tolerance:
                return report(RelaxStatus.CONVERGED)
            if waited >= PATIENCE and not resolved(energies):
                return report(RelaxStatus.STALLED)

            slope = self._reader.read(self.state).slope
            reference = max(energies[-self._method.memory :])
            trials: list[Trial] = []
            trial = search(lambda s: self._attempt(s, trials), length, reference, slope, self._method.slope_ratio)
            evaluations += len(trials)
            if trial is None:
                return report(RelaxStatus.STALLED)
            if trial is not trials[-1]:
                trial = self._attempt(trial.length, trials)
                evaluations += 1
            self.state, self._other = self._other, self.state
            energy, inverted, products, length = trial.energy, trial.inverted, trial.products, trial.length
            energies.append(energy.total)
            history.append(RelaxStep(energy.total, estimate, length, spent))
        return report(RelaxStatus.STEP_LIMIT)

    def _attempt(self, length: float, trials: list[Trial]) -> Trial:
        """Evaluates the other state at a length along the direction."""
        self._length.fill_(length)
        self._step[self.state]()
        self._other.evaluate()
        energy, inverted, newly_inverted = self._other.read()
        trials.append(Trial(length, energy, inverted, newly_inverted, self._reader.read(self._other)))
        return trials[-1]


def resolved(energies: list[float]) -> bool:
    """Whether the last few steps lowered the energy by more than its rounding."""
    if len(energies) <= PATIENCE:
        return True
    return energies[-PATIENCE - 1] - energies[-1] > 1e-7 * abs(energies[-1])
