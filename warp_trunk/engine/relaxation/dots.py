"""Scalar products that stay on the device, one for each iteration of a solver."""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from ..model import Model

PADDING = 8
"""Doubles between two ranges' parts of a product: a cache line."""


@dataclass(frozen=True)
class Dots:
    """Where launches add a scalar product of their vectors, each range its own part."""

    iteration: wp.array
    """The row that is written, shape (1,), int32."""
    products: wp.array
    """The products by iteration and range, shape (rows, PADDING * ranges), float64."""

    @classmethod
    def of(cls, model: Model, iteration: wp.array, rows: int) -> Dots:
        """Room for the products of some iterations, all zero."""
        return cls(iteration, model.zeros(wp.float64, rows, PADDING * model.parallel.ranges))

    @classmethod
    def unread(cls, model: Model) -> Dots:
        """For launches whose product nobody needs."""
        return cls.of(model, model.zeros(wp.int32, 1), 1)
