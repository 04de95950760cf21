"""The vector steps of the projected loop: a step along a direction, and what the host reads of a point.

Free nodes come first in every array, so projection onto the prescribed bones is the length of the launch.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .reduction import adder, keep_largest

SLOPE, GRADIENT_SQUARED, DIRECTION_SQUARED, GRADIENT_CHANGE, PREVIOUS_SLOPE, PREVIOUS_SQUARED = range(6)
"""Columns of the products."""


@cache
def loop_kernels(scalar: type, cuda: bool) -> SimpleNamespace:
    """The kernels of the loop, in one precision."""
    add = adder(cuda)
    vec3 = wp.types.vector(3, scalar)

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
        slope = wp.float64(0.0)
        g2 = wp.float64(0.0)
        d2 = wp.float64(0.0)
        change = wp.float64(0.0)
        before = wp.float64(0.0)
        old2 = wp.float64(0.0)
        if i < end:
            g = gradient[i]
            d = direction[i]
            old = previous[i]
            slope = wp.float64(wp.dot(g, d))
            g2 = wp.float64(wp.dot(g, g))
            d2 = wp.float64(wp.dot(d, d))
            change = wp.float64(wp.dot(g, g - old))
            before = wp.float64(wp.dot(old, d))
            old2 = wp.float64(wp.dot(old, old))
        add(products, slab, SLOPE, slope)
        add(products, slab, GRADIENT_SQUARED, g2)
        add(products, slab, DIRECTION_SQUARED, d2)
        add(products, slab, GRADIENT_CHANGE, change)
        add(products, slab, PREVIOUS_SLOPE, before)
        add(products, slab, PREVIOUS_SQUARED, old2)

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
        if i < end:
            keep_largest(longest, slab, 0, wp.float64(wp.length_sq(vectors[i])))

    return SimpleNamespace(
        step=step_kernel,
        products=products_kernel,
        descend=descend_kernel,
        foresee=foresee_kernel,
        longest=longest_kernel,
    )
