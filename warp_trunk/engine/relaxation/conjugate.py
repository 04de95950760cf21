"""Nonlinear conjugate gradients of Polak and Ribiere, the papers' family of methods."""

from __future__ import annotations

import warp as wp

from ..model import Model
from ..state import State
from .gradient import first_length, mean_edge, steer
from .products import Products


class Conjugate:
    """d = -g + beta d, beta = max(0, g.(g - g_last) / g_last.g_last)."""

    memory = 1
    """Energies the line search looks back on."""
    slope_ratio: float | None = 0.1
    """The line search ends where the slope has fallen to this part: conjugacy needs a near-exact length."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.direction = model.array(None, model.vec3, (model.free,))
        self._keep = model.array(None, wp.float64, (1,))
        self._edge = mean_edge(model)

    def propose(self, state: State, products: Products | None, last_length: float) -> tuple[float, int]:
        """Sets the direction at the state; returns the length to try first and the linear iterations spent."""
        if products is None:
            steer(self.model, state, 0.0, self._keep, self.direction)
            return first_length(state, self._edge), 0
        beta = max(0.0, products.gradient_change / products.previous_squared)
        if beta * products.slope >= products.gradient_squared:  # -g + beta d would not descend
            beta = 0.0
        steer(self.model, state, beta, self._keep, self.direction)
        return last_length, 0
