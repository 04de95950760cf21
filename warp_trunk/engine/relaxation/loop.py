"""The projected loop: gradient, direction, line search, projection; it stops in mm or says why not.

Projection is the range of the launches: every step is taken over the free nodes of the model, so a node on
bone never moves by a bit (the mappings U of eq. 4.3 of [2]).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
import warp as wp

from warp_trunk.kernels.elements import COLUMNS
from warp_trunk.kernels.loop import loop_kernels

from ..model import Model
from ..state import State
from .conjugate import Conjugate
from .gradient import Gradient
from .line_search import Trial, search
from .newton import Newton
from .outcome import Relaxation, RelaxOptions, RelaxStatus, RelaxStep
from .products import ProductReader, Products

ESTIMATE_EVERY = 50
"""Steps of a gradient method between two Newton solves that tell how far the equilibrium is."""
ROUNDING = {"float32": 1e-7, "float64": 1e-14}
"""Relative change of the energy that the precision does not resolve."""
ROUNDING_STEPS = 10.0
"""Roundings of the largest displacement that a force summed over a node's tetrahedra may hide."""
PATIENCE = 8
"""Estimates in a row that are no smaller, once the energy no longer resolves a step, before the loop gives up."""


class Relaxer:
    """Everything a relaxation needs on the device, made once for a model with free nodes."""

    state: State
    """The configuration that holds: set it, relax it, read it. Its arrays stay the same."""

    def __init__(self, model: Model, options: RelaxOptions | None = None) -> None:
        self.model = model
        self.options = options or RelaxOptions()
        self.state = State(model)
        if not model.free_nodes:
            return
        self._trial = State(model, start=self.state)
        self._newton = Newton(self.state)
        methods = {"newton": lambda _: self._newton, "conjugate": Conjugate, "gradient": Gradient}
        self._method: Newton | Conjugate | Gradient = methods[self.options.method](self.state)
        direction = self._method.direction
        self._products = ProductReader(self.state, direction, self.state.gradient)
        self._trial_products = ProductReader(self._trial, direction, self.state.gradient)
        self._length = model.zeros(wp.float64, 1)
        self._rounding = ROUNDING[model.precision]
        self._longest = model.zeros(wp.float64, model.parallel.ranges, COLUMNS)
        kernels = loop_kernels(*model.variant)
        self._find_longest = model.over_nodes(kernels.longest, [self.state.displacement], [self._longest])
        self._step = model.over_free(
            kernels.step,
            [self._length, self.state.displacement, direction],
            [self._trial.displacement],
        )

    def relax(
        self, tolerance: float | None = None, watch: Callable[[RelaxStep, State], None] | None = None
    ) -> Relaxation:
        """Relaxes `state` until the estimated distance to equilibrium is below the tolerance [mm].

        The estimate is that of the state before the last step, which is taken all the same.

        The energy falls at every accepted step (over ten for `gradient`), no tetrahedron is inverted
        that was not inverted at the start, and the number of steps is bounded. `watch` is told of each
        accepted step and sees the state after it, to read and not to change.
        """
        start = time.perf_counter()
        tolerance = self.options.tolerance if tolerance is None else tolerance
        self.state.evaluate()
        energy, inverted, _ = self.state.read()
        history: list[RelaxStep] = []
        linear_iterations, evaluations, estimate = 0, 1, math.inf

        def report(status: RelaxStatus) -> Relaxation:
            return Relaxation(
                status, energy, len(history), linear_iterations, evaluations, estimate, inverted, tuple(history)
            )

        if not math.isfinite(energy.total):
            return report(RelaxStatus.NOT_FINITE)
        if not self.model.free_nodes:
            estimate = 0.0
            return report(RelaxStatus.CONVERGED)
        newton, method = self._newton, self._method
        floor = self._begin(tolerance)
        energies = [energy.total]
        products: Products | None = None
        length, least, waited = 0.0, math.inf, 0
        for step in range(self.options.max_steps):
            length, spent = method.propose(products, length)
            if method is not newton and step % ESTIMATE_EVERY == 0:
                newton.begin(tolerance, floor)
                spent += newton.propose(None, 1.0)[1]
            linear_iterations += spent
            if method is newton or step % ESTIMATE_EVERY == 0:
                estimate = newton.distance
                waited = 0 if estimate < 0.9 * least else waited + 1
                least = min(least, estimate)
                if waited >= PATIENCE and not self._resolved(energies):
                    return report(RelaxStatus.STALLED)
            slope = self._products.read().slope
            reference = max(energies[-method.memory :])
            trial, attempts = self._search(length, reference, slope)
            evaluations += attempts
            if trial is None:
                return report(RelaxStatus.CONVERGED if estimate <= tolerance else RelaxStatus.STALLED)
            self.state.copy_from(self._trial)
            energy, inverted, products, length = trial.energy, trial.inverted, trial.products, trial.length
            energies.append(energy.total)
            history.append(RelaxStep(energy, estimate, length, spent, time.perf_counter() - start))
            if watch is not None:
                watch(history[-1], self.state)
            if estimate <= tolerance:
                return report(RelaxStatus.CONVERGED)
        return report(RelaxStatus.STEP_LIMIT)

    def _begin(self, tolerance: float) -> float:
        """Gets ready for a relaxation to a tolerance [mm]; returns what rounding leaves of every distance [mm]."""
        self._trial.copy_from(self.state)  # the nodes that no step moves
        floor = ROUNDING_STEPS * float(np.finfo(self.model.precision).eps) * self._largest_displacement()
        self._newton.begin(tolerance, floor)
        return floor

    def _search(self, length: float, reference: float, slope: float) -> tuple[Trial | None, int]:
        """The trial along the direction that is taken, None if none is, and how many were made."""
        ratio = self._method.slope_ratio
        return search(self._attempt, length, reference, slope, ratio, rounding=self._rounding)

    def _largest_displacement(self) -> float:
        """Largest displacement of a node from rest [mm]."""
        self._longest.zero_()
        self._find_longest()
        return float(self._longest.numpy().max()) ** 0.5

    def _resolved(self, energies: list[float]) -> bool:
        """Whether the steps of the last PATIENCE estimates lowered the energy by more than its rounding."""
        steps = PATIENCE * (1 if self._method is self._newton else ESTIMATE_EVERY)
        fall = min(energies[:-steps], default=math.inf) - min(energies[-steps:])
        return fall > self._rounding * abs(energies[-1])

    def _attempt(self, length: float) -> Trial:
        """Evaluates the trial at a length along the direction."""
        self._length.fill_(length)
        self._step()
        self._trial.evaluate()
        energy, inverted, newly_inverted = self._trial.read()
        return Trial(length, energy, inverted, newly_inverted, self._trial_products.read())
