"""The papers' relaxation: the energy is lowered along its gradient, projected onto the free nodes (line 8 of
Algorithm 1 of [1], eq. 4.3 of [2]).

It ends where the energy no longer falls. On a fine mesh that is far from the equilibrium: the energy of long waves
of soft tissue changes less than it rounds. One Newton solve there estimates how far, in mm."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import warp as wp

from warp_trunk.kernels.vectors import vector_kernels

from .history import History
from .line_search import search
from .newton import Relaxer, estimate_distance
from .relaxation import Relaxation, RelaxStatus, RelaxStep
from .state import Products, State, longest
from .work import Work

MEMORY = 10
"""Energies the line search looks back on: a spectral step may raise the energy for a while."""
FALLING_STEPS = 50
"""Steps over which the energy must fall by more than it rounds."""
FIRST_MOVE = 0.01
"""The part of a mean edge by which the first step is tried to move the node of the largest gradient."""


class ProjectedGradient:
    """The loop for the state of a relaxer, whose Newton solve then estimates how far the equilibrium is."""

    def __init__(self, relaxer: Relaxer) -> None:
        """Records the direction downhill."""
        self._relaxer, model = relaxer, relaxer.model
        if (work := relaxer.work) is not None:
            downhill = [model.array(np.array([-1.0]), wp.float64), model.free_vectors(), relaxer.state.gradient]
            self._turn_downhill = model.over_free(vector_kernels(model.scalar).step, downhill, [work.direction])
        edges = model.rest[model.corners[:, [0, 0, 0, 1, 1, 2]]] - model.rest[model.corners[:, [1, 2, 3, 2, 3, 3]]]
        self._mean_edge = float(np.linalg.norm(edges, axis=-1).mean())

    def relax(
        self, watch: Callable[[RelaxStep, State], None] | None = None, user: object | None = None
    ) -> Relaxation:
        """Lowers the energy until it no longer falls; ends STOPPED, with the estimated distance, or STEP_LIMIT.

        `watch` is called after each accepted step, whose estimated error is not known; for it and `user` see
        `Relaxer.relax`.
        """
        return self._relaxer.evaluate_and(self._descend, watch, user)

    def _descend(self, work: Work, history: History) -> Relaxation:
        """The loop; see `relax`."""
        length = self._first_length()
        for _step in range(self._relaxer.options.max_steps):
            self._turn_downhill()
            reference, slope = history.largest_energy(MEMORY), work.products().slope
            trial = search(work.attempt, length, reference, slope, rounding=history.rounding)
            history.evaluations = work.evaluations
            if trial is not None:
                work.accept()
                length = spectral_length(trial.length, trial.products)
                history.add(trial)
            if trial is None or not history.falls(FALLING_STEPS):
                distance, history.linear_iterations = estimate_distance(work)
                return history.end(RelaxStatus.STOPPED, distance)
            history.solved(math.inf)
        return history.end(RelaxStatus.STEP_LIMIT, math.inf)

    def _first_length(self) -> float:
        """A length that moves the node of the largest gradient by a part of a mean edge."""
        steepest = float(longest(self._relaxer.state.gradient.numpy()[self._relaxer.model.free]))
        return FIRST_MOVE * self._mean_edge / steepest if steepest > 0.0 else 1.0


def spectral_length(length: float, products: Products) -> float:
    """The first length after a step of some length: s . s / s . y of Barzilai and Borwein."""
    curvature = products.slope - products.previous_slope
    return length * products.direction_squared / curvature if curvature > 0.0 else 10.0 * length
