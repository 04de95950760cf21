"""How much the curvature changes along a vector, by the gradient there."""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from warp_trunk.kernels.loop import loop_kernels

from ..host_report import Report
from ..parallel import Launch
from ..state import State
from .conjugate_gradient import ConjugateGradient
from .dots import Dots
from .preconditioner import Preconditioner


class CurvatureChange:
    """What a whole Newton step along a solution e of H e = -b would leave of itself.

    For a step s e that is what the change of the gradient over it, g(u + s e) - g(u), differs by from s H e, as a
    part of s H e in the preconditioner's norm. That is half the relative change of the curvature along the step,
    and in proportion to its length.
    """

    def __init__(
        self, state: State, preconditioner: Preconditioner, solver: ConjugateGradient, right_side: wp.array
    ) -> None:
        """For solutions of a solver, of a right side b, shape (free nodes,), vec3, at a state."""
        model = state.model
        self._state, self._there = state, State(model)
        self._scale = model.zeros(wp.float64, 1)
        self._force, self._change, z = (model.free_vectors() for _ in range(3))
        one, minus_one = (model.array(np.array([value]), wp.float64) for value in (1.0, -1.0))
        kernel = loop_kernels(*model.variant).step

        def add(scale: wp.array, first: wp.array, second: wp.array, total: wp.array) -> Launch:
            return model.over_free(kernel, [scale, first, second], [total])

        self._go = add(self._scale, state.displacement, solver.solution, self._there.displacement)
        self._add_residual = add(one, right_side, solver.residual, self._force)  # -H e
        self._subtract = add(minus_one, self._there.gradient, state.gradient, self._change)
        self._add_force = add(self._scale, self._change, self._force, self._change)
        self._dots = Dots.unread(model)
        self._told = Report(model.parallel, self._dots.products)
        self._measure_force, self._measure_change = (
            preconditioner.apply(vector, z, self._dots) for vector in (self._force, self._change)
        )

    def left(self, scale: float) -> float:
        """The part of itself that a step of so many solutions would leave."""
        wp.copy(self._there.displacement, self._state.displacement)
        self._scale.fill_(scale)
        self._go()
        self._there.evaluate()
        self._add_residual()
        self._subtract()
        self._add_force()
        return self._norm(self._measure_change) / max(scale * self._norm(self._measure_force), 1e-300)

    def _norm(self, measure: Launch) -> float:
        """The square root of v . M^-1 v."""
        self._dots.products.zero_()
        measure()
        self._told.send()
        return math.sqrt(max(0.0, float(self._told.read().sum())))
