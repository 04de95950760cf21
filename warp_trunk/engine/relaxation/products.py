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

from ..host_report import Report
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
    """g . (g - the earlier g)."""
    previous_slope: float
    """(the earlier g) . d."""
    previous_squared: float
    """(the earlier g) squared."""


class ProductReader:
    """Computes the products of one state's gradient with a direction and an earlier gradient."""

    def __init__(self, state: State, direction: wp.array, previous: wp.array) -> None:
        model = state.model
        self._products = model.zeros(wp.float64, model.parallel.ranges, COLUMNS)
        self._told = Report(model.parallel, self._products)
        self._launch = model.over_free(
            loop_kernels(*model.variant).products, [state.gradient, direction, previous], [self._products]
        )

    def take(self) -> None:
        """Computes the products of the vectors as they are now, on the device."""
        self._products.zero_()
        self._launch()
        self._told.send()

    def read(self) -> Products:
        """The products last taken; waits for the device."""
        sums = self._told.read().sum(axis=0)
        return Products(
            slope=float(sums[SLOPE]),
            gradient_squared=float(sums[GRADIENT_SQUARED]),
            direction_squared=float(sums[DIRECTION_SQUARED]),
            gradient_change=float(sums[GRADIENT_CHANGE]),
            previous_slope=float(sums[PREVIOUS_SLOPE]),
            previous_squared=float(sums[PREVIOUS_SQUARED]),
        )
