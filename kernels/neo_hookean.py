"""The stable neo-Hookean energy over linear tetrahedra: energy with gradient, and curvature, each one kernel.

A kernel is made for one precision; gravity that is off is not compiled in.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from .elements import (
    FIRST_TERM,
    INVERTED,
    NEWLY_INVERTED,
    add_gradient,
    curvature_adder,
    sums_of_blocks,
    vec16i,
)
from .gravity import gravity_term
from .reduction import adder
from .stable_neo_hookean import bounded_turn, cofactor, cofactor_of_sum, dilation, neo_hookean, stretch

VOLUME, GRAVITY, SHAPE = range(FIRST_TERM, FIRST_TERM + 3)
"""Columns of its terms."""


@wp.func
def curvature_block(c: Any, f_weight: Any, bulk: Any, f: Any, g: Any, a: Any, b: Any):
    """Second derivative in the edge vectors of shape gradients a and b per rest volume, but for the turn."""
    identity = wp.identity(n=3, dtype=type(c))
    return c * wp.dot(a, b) * identity + f_weight * wp.outer(f * a, f * b) + bulk * wp.outer(g * a, g * b)


@cache
def neo_hookean_kernels(scalar: type, cuda: bool, layered: bool, gravity: bool) -> SimpleNamespace:
    """The kernels `gradient`, `curvature` (made positive) and `true_curvature` in one precision.

    `layered` tissue has constants for each tetrahedron, uniform tissue one set for all.
    """
    add, add_curvature, blocks_type = adder(cuda), curvature_adder(scalar, cuda), sums_of_blocks(scalar, cuda)
    vec2 = wp.types.vector(2, scalar)
    vec3 = wp.types.vector(3, scalar)
    zero = wp.constant(scalar(0.0))
    gravity_on = gravity

    @wp.kernel(module="unique", enable_backward=False)
    def gradient_kernel(
        first: int,
        end: int,
        slab: int,
        tets: wp.array(dtype=wp.vec4i),
        shape_gradient: wp.array(dtype=vec3, ndim=2),
        rest_volume: wp.array(dtype=scalar),
        moduli: wp.array(dtype=vec2),
        gravity_weight: wp.array(dtype=scalar),
        inverted_before: wp.array(dtype=wp.int8),
        displacement: wp.array(dtype=vec3),
        gradient: wp.array(dtype=vec3, ndim=2),
        inverted: wp.array(dtype=wp.int8),
        sums: wp.array(dtype=wp.float64, ndim=2),
    ):
        t = first + wp.tid()
        e_shape = zero
        e_volume = zero
        e_gravity = zero
        is_inverted = wp.int32(0)
        is_new = wp.int32(0)
        if t < end:
            n = tets[t]
            k = 0
            if wp.static(layered):
                k = t
            a = shape_gradient[t, 0]
            b = shape_gradient[t, 1]
            c = shape_gradient[t, 2]
            u0 = displacement[n[0]]
            u1 = displacement[n[1]]
            u2 = displacement[n[2]]
            u3 = displacement[n[3]]
            h = wp.outer(u1 - u0, a) + wp.outer(u2 - u0, b) + wp.outer(u3 - u0, c)
            v0 = rest_volume[t]
            shape, volume, stress, growth = neo_hookean(h, moduli[k][0], moduli[k][1])
            e_shape = v0 * shape
            e_volume = v0 * volume
            up = vec3()
            if wp.static(gravity_on):
                weight = gravity_weight[k] * v0
                e_gravity = gravity_term(u0, u1, u2, u3, weight)
                up = vec3(zero, zero, weight)
            stress = v0 * stress
            add_gradient(gradient, slab, n, stress * a, stress * b, stress * c, up)
            if not (growth > scalar(-1.0)):
                is_inverted = wp.int32(1)
                if inverted_before[t] == wp.int8(0):
                    is_new = wp.int32(1)
            inverted[t] = wp.int8(is_inverted)
        add(sums, slab, SHAPE, wp.float64(e_shape))
        add(sums, slab, VOLUME, wp.float64(e_volume))
        if wp.static(gravity_on):
            add(sums, slab, GRAVITY, wp.float64(e_gravity))
        add(sums, slab, INVERTED, wp.float64(is_inverted))
        add(sums, slab, NEWLY_INVERTED, wp.float64(is_new))

    def make_curvature(positive: bool) -> wp.Kernel:
        @wp.kernel(module="unique", enable_backward=False)
        def curvature_kernel(
            first: int,
            end: int,
            slab: int,
            tets: wp.array(dtype=wp.vec4i),
            shape_gradient: wp.array(dtype=vec3, ndim=2),
            rest_volume: wp.array(dtype=scalar),
            moduli: wp.array(dtype=vec2),
            gravity_weight: wp.array(dtype=scalar),
            block_of: wp.array(dtype=vec16i),
            displacement: wp.array(dtype=vec3),
            blocks: blocks_type,
        ):
            t = first + wp.tid()
            if t < end:
                n = tets[t]
                k = 0
                if wp.static(layered):
                    k = t
                a = shape_gradient[t, 0]
                b = shape_gradient[t, 1]
                c = shape_gradient[t, 2]
                u0 = displacement[n[0]]
                h = (
                    wp.outer(displacement[n[1]] - u0, a)
                    + wp.outer(displacement[n[2]] - u0, b)
                    + wp.outer(displacement[n[3]] - u0, c)
                )
                mu = moduli[k][0]
                bulk = moduli[k][1]
                v0 = rest_volume[t]
                cof_h = cofactor(h)
                f = wp.identity(n=3, dtype=scalar) + h
                g = cofactor_of_sum(h, cof_h)
                x = stretch(h)
                j = dilation(h, cof_h)
                across = mu * (scalar(3.0) + x) / (scalar(4.0) + x)
                turn = bulk * j - scalar(0.75) * mu
                if wp.static(positive):
                    turn = bounded_turn(across, bulk, turn, h, x, j)
                along = (mu + mu) / ((scalar(4.0) + x) * (scalar(4.0) + x))
                ab_turn = -turn * wp.skew(f * wp.cross(a, b))
                bc_turn = -turn * wp.skew(f * wp.cross(b, c))
                ca_turn = -turn * wp.skew(f * wp.cross(c, a))
                aa = curvature_block(across, along, bulk, f, g, a, a)
                bb = curvature_block(across, along, bulk, f, g, b, b)
                cc = curvature_block(across, along, bulk, f, g, c, c)
                ab = curvature_block(across, along, bulk, f, g, a, b) + ab_turn
                bc = curvature_block(across, along, bulk, f, g, b, c) + bc_turn
                ac = curvature_block(across, along, bulk, f, g, a, c) - ca_turn
                add_curvature(blocks, slab, t, block_of, v0 * aa, v0 * ab, v0 * ac, v0 * bb, v0 * bc, v0 * cc)

        return curvature_kernel

    return SimpleNamespace(
        gradient=gradient_kernel,
        curvature=make_curvature(positive=True),
        true_curvature=make_curvature(positive=False),
    )
