"""The vector steps of the projected loop: a step along a direction, and what the host reads of a point.

Free nodes come first in every array, so projection onto the prescribed bones is the length of the launch.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .reduction import columns_adder, largest_keeper

SLOPE, GRADIENT_SQUARED, DIRECTION_SQUARED, GRADIENT_CHANGE, PREVIOUS_SLOPE, PREVIOUS_SQUARED = range(6)
"""Columns of the products."""
PRODUCTS = 6
"""Their number."""


@cache
def loop_kernels(scalar: type, cuda: bool) -> SimpleNamespace:
    """The kernels of the loop, in one precision."""
    add, keep_largest = columns_adder(cuda, PRODUCTS), largest_keeper(cuda)
    vec3 = wp.types.vector(3, scalar)
    products_type = wp.types.vector(PRODUCTS, wp.float64)

    @wp.kernel(module="unique", enable_backward=False)
    def step_kernel(
        first: int,
        end: int,
        slab: int,
        length: wp.array(dtype=wp.float64),
        displacement: wp.array(dtype=vec3),
        direction: wp.array(dtype=vec3),
        trial: wp.array(dtype=vec3),
    ):
        """trial = displacement + length * direction, free nodes only."""
        i = first + wp.tid()
        if i < end:
            trial[i] = displacement[i] + scalar(length[0]) * direction[i]

    @wp.kernel(module="unique", enable_backward=False)
    def products_kernel(
        first: int,
        end: int,
        slab: int,
        gradient: wp.array(dtype=vec3),
        direction: wp.array(dtype=vec3),
        previous: wp.array(dtype=vec3),
        products: wp.array(dtype=wp.float64, ndim=2),
    ):
        """Products of the gradient with itself, with the direction and with an earlier gradient."""
        i = first + wp.tid()
        found = products_type()
        if i < end:
            g = gradient[i]
            d = direction[i]
            old = previous[i]
            found[SLOPE] = wp.float64(wp.dot(g, d))
            found[GRADIENT_SQUARED] = wp.float64(wp.dot(g, g))
            found[DIRECTION_SQUARED] = wp.float64(wp.dot(d, d))
            found[GRADIENT_CHANGE] = wp.float64(wp.dot(g, g - old))
            found[PREVIOUS_SLOPE] = wp.float64(wp.dot(old, d))
            found[PREVIOUS_SQUARED] = wp.float64(wp.dot(old, old))
        add(products, slab, 0, found)

    @wp.kernel(module="unique", enable_backward=False)
    def descend_kernel(
        first: int,
        end: int,
        slab: int,
        gradient: wp.array(dtype=vec3),
        keep: wp.array(dtype=wp.float64),
        direction: wp.array(dtype=vec3),
    ):
        """direction = -gradient + keep * direction (the one minus sign of the gradient methods)."""
        i = first + wp.tid()
        if i < end:
            direction[i] = scalar(keep[0]) * direction[i] - gradient[i]

    @wp.kernel(module="unique", enable_backward=False)
    def foresee_kernel(
        first: int,
        end: int,
        slab: int,
        share: wp.array(dtype=wp.float64),
        part: wp.array(dtype=wp.float64),
        displacement: wp.array(dtype=vec3),
        earlier: wp.array(dtype=vec3),
        move: wp.array(dtype=vec3),
        bend: wp.array(dtype=vec3),
    ):
        """Takes note of the last move and a share of its change, and goes on by the move and a part of the change.

        Free nodes only; `earlier` becomes the displacement, which becomes the expected one.
        """
        i = first + wp.tid()
        if i < end:
            now = displacement[i]
            last = now - earlier[i]
            bend[i] += scalar(share[0]) * ((last - move[i]) - bend[i])
            move[i] = last
            earlier[i] = now
            displacement[i] = now + (last + scalar(part[0]) * bend[i])

    @wp.kernel(module="unique", enable_backward=False)
    def longest_kernel(
        first: int,
        end: int,
        slab: int,
        vectors: wp.array(dtype=vec3),
        longest: wp.array(dtype=wp.float64, ndim=2),
    ):
        """Largest squared length of a vector."""
        i = first + wp.tid()
        squared = wp.float64(0.0)
        if i < end:
            squared = wp.float64(wp.length_sq(vectors[i]))
        keep_largest(longest, slab, 0, squared)

    return SimpleNamespace(
        step=step_kernel,
        products=products_kernel,
        descend=descend_kernel,
        foresee=foresee_kernel,
        longest=longest_kernel,
    )
