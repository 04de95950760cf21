"""The papers' relaxation: the energy is lowered along its gradient, projected onto the free nodes (line 8 of
Algorithm 1 of [1], eq. 4.3 of [2]).

It ends where the energy no longer falls. On a fine mesh that is far from the equilibrium: the energy of long waves
of soft tissue changes less than it rounds. One Newton solve there estimates how far, in mm."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial

import numpy as np
import warp as wp

from warp_trunk.kernels.vectors import vector_kernels

from .line_search import Trial, search
from .newton import Relaxer
from .relaxation import ROUNDING, History, Relaxation, RelaxStatus, RelaxStep
from .state import ProductReader, Products, State

MEMORY = 10
"""Energies the line search looks back on: a spectral step may raise the energy for a while."""
PATIENCE = 50
"""Steps over which the energy must fall by more than it rounds."""
FIRST_MOVE = 0.01
"""The part of a mean edge by which the first step is tried to move the node of the largest gradient."""


class ProjectedGradient:
    """The loop for the state of a relaxer, whose Newton solve then estimates how far the equilibrium is."""

    def __init__(self, relaxer: Relaxer) -> None:
        """Records the launches."""
        self._relaxer, self._state = relaxer, relaxer.state
        model = relaxer.model
        self._trial = State(model, start=self._state)
        self._direction, self._length = model.free_vectors(), model.zeros(wp.float64, 1)
        kernels = vector_kernels(model.scalar)
        downhill = [model.array(np.array([-1.0]), wp.float64), model.free_vectors(), self._state.gradient]
        self._turn_downhill = model.over_free(kernels.step, downhill, [self._direction])
        self._step = model.over_free(
            kernels.step, [self._length, self._state.displacement, self._direction], [self._trial.displacement]
        )
        self._products = ProductReader(self._state, self._direction, self._state.gradient)
        self._trial_products = ProductReader(self._trial, self._direction, self._state.gradient)
        edges = model.rest[model.corners[:, [0, 0, 0, 1, 1, 2]]] - model.rest[model.corners[:, [1, 2, 3, 2, 3, 3]]]
        self._mean_edge = float(np.linalg.norm(edges, axis=-1).mean())

    def relax(
        self, watch: Callable[[RelaxStep, State], None] | None = None, user: object | None = None
    ) -> Relaxation:
        """Lowers the energy until it no longer falls; ends STOPPED, with the estimated distance, or STEP_LIMIT.

        `watch` is called after each accepted step, whose estimated error is not known; for it and `user` see
        `Relaxer.relax`.
        """
        return self._relaxer.ownership.work(user, self._relax, watch)

    def _relax(self, watch: Callable[[RelaxStep, State], None] | None) -> Relaxation:
        """See `relax`."""
        start, state, model = time.perf_counter(), self._state, self._relaxer.model
        state.evaluate()
        energy, inverted, _ = state.read()
        history = History(
            energy, inverted, ROUNDING[model.precision], start, watch=watch and partial(state.show, watch)
        )
        if not math.isfinite(energy.total):
            return history.end(RelaxStatus.NOT_FINITE, math.inf)
        if not model.free_nodes:
            return history.end(RelaxStatus.CONVERGED, 0.0)
        wp.copy(self._trial.displacement, state.displacement)  # no step moves prescribed nodes
        length = self._first_length()
        for _step in range(self._relaxer.options.max_steps):
            slope = self._descend()
            reference = history.largest_energy(MEMORY)
            trial, attempts = search(self._attempt, length, reference, slope, rounding=history.rounding)
            history.evaluations += attempts
            if trial is not None:
                state.copy_from(self._trial)
                length = spectral_length(trial.length, trial.products)
                history.add(trial)
            if trial is None or not history.falls(PATIENCE):
                distance, iterations = self._relaxer.estimate_distance()
                history.linear_iterations = iterations
                return history.end(RelaxStatus.STOPPED, distance)
            history.solved(math.inf)
        return history.end(RelaxStatus.STEP_LIMIT, math.inf)

    def _descend(self) -> float:
        """Sets the direction to the negative gradient of the free nodes; returns the slope along it."""
        self._turn_downhill()
        self._products.launch()
        return self._products.read().slope

    def _first_length(self) -> float:
        """A length that moves the node of the largest gradient by a part of a mean edge."""
        gradient = self._state.gradient.numpy()[self._relaxer.model.free]
        steepest = float(np.linalg.norm(gradient.astype(np.float64), axis=1).max())
        return FIRST_MOVE * self._mean_edge / steepest if steepest > 0.0 else 1.0

    def _attempt(self, length: float) -> Trial:
        """Evaluates the trial at a length along the direction."""
        self._length.fill_(length)
        self._step()
        self._trial.evaluate()
        self._trial_products.launch()
        return Trial.read(length, self._trial, self._trial_products)


def spectral_length(length: float, products: Products) -> float:
    """The first length after a step of some length: s . s / s . y of Barzilai and Borwein."""
    curvature = products.slope - products.previous_slope
    return length * products.direction_squared / curvature if curvature > 0.0 else 10.0 * length
