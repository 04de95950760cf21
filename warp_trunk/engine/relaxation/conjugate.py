"""Nonlinear conjugate gradients of Polak and Ribiere, the papers' family of methods."""

from __future__ import annotations

from ..state import State
from .gradient import Descent, first_length, mean_edge
from .products import Products


class Conjugate:
    """d = -g + beta d, beta = max(0, g.(g - g_last) / g_last.g_last)."""

    memory = 1
    """Energies the line search looks back on."""
    slope_ratio: float | None = 0.1
    """The line search ends where the slope has fallen to this part: conjugacy needs a near-exact length."""

    def __init__(self, state: State) -> None:
        model = state.model
        self.direction = model.free_vectors()
        self._state = state
        self._descend = Descent(state, self.direction)
        self._edge = mean_edge(model)

    def propose(self, products: Products | None, last_length: float) -> tuple[float, int]:
        """Sets the direction at the state; returns the length to try first and the linear iterations spent."""
        if products is None:
            self._descend(0.0)
            return first_length(self._state, self._edge), 0
        beta = max(0.0, products.gradient_change / products.previous_squared)
        if beta * products.slope >= products.gradient_squared:  # -g + beta d would not descend
            beta = 0.0
        self._descend(beta)
        return last_length, 0
