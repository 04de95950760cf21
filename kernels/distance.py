"""Distance term, eq. 4.8 and 4.12 of [2]: the square of an edge's stretch."""

from typing import Any

import warp as wp

from .geometry import direction_of, relative_norm_change


@wp.func
def distance_term(rest: Any, change: Any, rest_length: Any, weight: Any):
    """Energy w ((l - l0) / l0)^2 of one edge vector, and its gradient with respect to the vector."""
    stretch = relative_norm_change(rest, change, rest_length)
    force = weight * (stretch + stretch) / rest_length
    return weight * stretch * stretch, force * direction_of(rest + change)


@wp.func
def distance_curvature(rest: Any, change: Any, rest_length: Any, weight: Any, positive: bool):
    """Second derivative of the distance term; where asked for, made positive semidefinite.

    A compressed edge is concave across its axis (l < l0): the part that `positive` leaves out.
    """
    edge = rest + change
    length = wp.length(edge)
    along = direction_of(edge)
    zero = type(length)(0.0)
    least = rest_length
    if not positive:
        least = zero
    across = wp.where(length > least, type(length)(1.0) - rest_length / length, zero)
    stiffness = (weight + weight) / (rest_length * rest_length)
    identity = wp.identity(n=3, dtype=type(length))
    axial = wp.outer(along, along)
    return stiffness * (axial + across * (identity - axial))
