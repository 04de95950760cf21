"""The few numbers the host reads of a state and a direction."""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from warp_trunk.kernels.elements import COLUMNS
from warp_trunk.kernels.loop import (
    DIRECTION_SQUARED,
    GRADIENT_CHANGE,
    GRADIENT_SQUARED,
    PREVIOUS_SLOPE,
    PREVIOUS_SQUARED,
    SLOPE,
    loop_kernels,
)

from ..model import Model
from ..state import State


@dataclass(frozen=True)
class Products:
    """Scalar products over the free nodes, in double precision."""

    slope: float
    """g . d, the derivative of the energy along the direction."""
    gradient_squared: float
    """g . g."""
    direction_squared: float
    """d . d."""
    gradient_change: float
    """g . (g - g of the other state)."""
    previous_slope: float
    """(g of the other state) . d."""
    previous_squared: float
    """(g of the other state) squared."""


class ProductReader:
    """Computes the products of two states with one direction."""

    def __init__(self, model: Model, states: tuple[State, State], direction: wp.array) -> None:
        kernels, ranges = loop_kernels(*model.variant), model.parallel.ranges
        self._products = model.array(None, wp.float64, (ranges, COLUMNS))
        a, b = states
        self._launch = {
            state: model.parallel.record(
                kernels.products,
                model.free,
                [ranges, direction, other.gradient],
                [state.gradient, self._products],
            )
            for state, other in ((a, b), (b, a))
        }

    def read(self, state: State) -> Products:
        """Products of the state's gradient with the direction and the other state's gradient."""
        self._products.zero_()
        self._launch[state]()
        sums = self._products.numpy().sum(axis=0)
        return Products(
            slope=float(sums[SLOPE]),
            gradient_squared=float(sums[GRADIENT_SQUARED]),
            direction_squared=float(sums[DIRECTION_SQUARED]),
            gradient_change=float(sums[GRADIENT_CHANGE]),
            previous_slope=float(sums[PREVIOUS_SLOPE]),
            previous_squared=float(sums[PREVIOUS_SQUARED]),
        )
