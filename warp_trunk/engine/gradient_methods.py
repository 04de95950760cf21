"""Gradient methods in the same projected loop: the papers' family, and the baseline of the benchmarks.

They shrink the gradient long before they near the equilibrium of a fine mesh.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import warp as wp

from warp_trunk.kernels.vectors import vector_kernels

from .line_search import Proposal
from .state import Products, State


class _Descent:
    """The launch of direction = -gradient + beta * direction, and a first length along it."""

    def __init__(self, state: State, direction: wp.array) -> None:
        """For a state; directions are kept in `direction`, shape (free nodes,), vec3."""
        model = state.model
        self._state, self._beta = state, model.zeros(wp.float64, 1)
        self._launch = model.over_free(
            vector_kernels(*model.variant).descend, [state.gradient, self._beta], [direction]
        )
        corners = model.rest[model.corners]
        lengths = [np.linalg.norm(corners[:, i] - corners[:, j], axis=1) for i, j in combinations(range(4), 2)]
        self._mean_edge = float(np.mean(lengths))

    def set_direction(self, beta: float) -> None:
        """Launches direction = -gradient + beta * direction."""
        self._beta.fill_(beta)
        self._launch()

    def first_length(self) -> float:
        """A length that moves the node of largest gradient by a hundredth of a mean edge [mm]."""
        gradient = self._state.gradient.numpy()[self._state.model.free]
        steepest = float((gradient.astype("float64") ** 2).sum(axis=1).max(initial=0.0) ** 0.5)
        return 0.01 * self._mean_edge / steepest if steepest > 0.0 else 1.0


class SpectralDescent(_Descent):
    """Spectral projected gradient: d = -g, first tried at the length s.s / s.y of Barzilai and Borwein."""

    memory = 10
    """A spectral step may raise the energy for a while; the search compares with the last ten."""
    slope_ratio: float | None = None
    """The line search takes the first decrease."""

    def propose(self, products: Products | None, last_length: float) -> Proposal:
        """Sets the direction at the state."""
        self.set_direction(0.0)
        if products is None:
            return Proposal(self.first_length())
        curvature = products.slope - products.previous_slope
        if curvature <= 0.0:
            return Proposal(10.0 * last_length)
        return Proposal(last_length * products.direction_squared / curvature)


class ConjugateDescent(_Descent):
    """Nonlinear conjugate gradients (Polak and Ribiere): d = -g + beta d, beta = max(0, g.(g - g') / g'.g')."""

    memory = 1
    """Energies the line search looks back on."""
    slope_ratio: float | None = 0.1
    """The line search ends where the slope has fallen to this part: conjugacy needs a near-exact length."""

    def propose(self, products: Products | None, last_length: float) -> Proposal:
        """Sets the direction at the state; along the gradient where no products of the last one are given."""
        if products is None:
            self.set_direction(0.0)
            return Proposal(self.first_length())
        beta = max(0.0, products.gradient_change / products.previous_squared)
        if beta * products.slope >= products.gradient_squared:  # -g + beta d would not descend
            beta = 0.0
        self.set_direction(beta)
        return Proposal(last_length)
