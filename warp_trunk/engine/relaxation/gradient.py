"""Spectral projected gradient: steepest descent with the step length of Barzilai and Borwein.

The baseline. It shrinks the gradient long before it nears the equilibrium of a fine mesh.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from warp_trunk.kernels.loop import loop_kernels

from ..features import EDGES
from ..model import Model
from ..state import State
from .products import Products


class Gradient:
    """d = -g, first tried at the length s.s / s.y of the last step."""

    memory = 10
    """A spectral step may raise the energy for a while; the search compares with the last ten."""
    slope_ratio: float | None = None
    """The line search takes the first decrease."""

    def __init__(self, state: State) -> None:
        model = state.model
        self.direction = model.free_vectors()
        self._state = state
        self._descend = Descent(state, self.direction)
        self._edge = mean_edge(model)

    def propose(self, products: Products | None, last_length: float) -> tuple[float, int]:
        """Sets the direction at the state; returns the length to try first and the linear iterations spent."""
        self._descend(0.0)
        if products is None:
            return first_length(self._state, self._edge), 0
        bend = products.slope - products.previous_slope
        if bend <= 0.0:
            return 10.0 * last_length, 0
        return last_length * products.direction_squared / bend, 0


class Descent:
    """The launch of direction = -gradient + keep * direction."""

    def __init__(self, state: State, direction: wp.array) -> None:
        model = state.model
        self._keep = model.zeros(wp.float64, 1)
        self._launch = model.over_free(
            loop_kernels(*model.variant).descend, [state.gradient, self._keep], [direction]
        )

    def __call__(self, keep: float) -> None:
        self._keep.fill_(keep)
        self._launch()


def mean_edge(model: Model) -> float:
    """Mean length of the tetrahedra's edges at rest [mm]."""
    ends = model.rest[model.corners[:, EDGES]]
    return float(np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2).mean())


def first_length(state: State, edge: float) -> float:
    """A length that moves the node of largest gradient by a hundredth of a mean edge [mm]."""
    gradient = state.gradient.numpy()[state.model.free]
    steepest = float((gradient.astype("float64") ** 2).sum(axis=1).max(initial=0.0) ** 0.5)
    return 0.01 * edge / steepest if steepest > 0.0 else 1.0
