"""The stable neo-Hookean energy of a linear tetrahedron: energy with gradient, and curvature.

They are made for one precision; gravity that is off is not compiled in.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from .elements import FIRST_TERM
from .formulas import Field, TetFormulas, struct_of
from .gravity import gravity_term
from .stable_neo_hookean import (
    bounded_turn,
    cofactor,
    cofactor_of_sum,
    dilation,
    neo_hookean,
    pressed,
    stiffened,
    stretch,
)
from .tet_kernels import tet_kernels

VOLUME, GRAVITY, SHAPE = range(FIRST_TERM, FIRST_TERM + 3)
"""Columns of its terms."""


@wp.func
def curvature_block(c: Any, f_weight: Any, bulk: Any, f: Any, g: Any, a: Any, b: Any):
    """Second derivative in the edge vectors of shape gradients a and b per rest volume, but for the turn."""
    identity = wp.identity(n=3, dtype=type(c))
    return c * wp.dot(a, b) * identity + f_weight * wp.outer(f * a, f * b) + bulk * wp.outer(g * a, g * b)


@cache
def neo_hookean_kernels(scalar: type, cuda: bool, layered: bool, gravity: bool) -> SimpleNamespace:
    """See `tet_kernels`."""
    return tet_kernels(neo_hookean_formulas(scalar, layered, gravity), cuda)


@cache
def neo_hookean_formulas(scalar: type, layered: bool, gravity: bool) -> TetFormulas:
    """Energy and curvature in one precision.

    `layered` tissue has constants for each tetrahedron, uniform tissue one set for all.
    """
    vec2, vec3, vec4 = (wp.types.vector(size, scalar) for size in (2, 3, 4))
    zero = wp.constant(scalar(0.0))
    gravity_on = gravity
    fields = {
        "shape_gradient": Field(vec3, 3),
        "rest_volume": Field(scalar),
        "moduli": Field(vec2),
        "gravity_weight": Field(scalar),
    }
    elements_type = struct_of(fields)

    @wp.func
    def evaluate(elements: elements_type, t: int, u0: vec3, u1: vec3, u2: vec3, u3: vec3):
        """Energies by term, relative change of volume, and the gradients of the four corners."""
        k = 0
        if wp.static(layered):
            k = t
        a = elements.shape_gradient[t, 0]
        b = elements.shape_gradient[t, 1]
        c = elements.shape_gradient[t, 2]
        h = wp.outer(u1 - u0, a) + wp.outer(u2 - u0, b) + wp.outer(u3 - u0, c)
        moduli = elements.moduli[k]
        v0 = elements.rest_volume[t]
        shape, volume, stress, growth = neo_hookean(h, moduli[0], moduli[1])
        stress = v0 * stress
        g1 = stress * a
        g2 = stress * b
        g3 = stress * c
        g0 = -(g1 + g2 + g3)
        e_gravity = zero
        if wp.static(gravity_on):
            weight = elements.gravity_weight[k] * v0
            e_gravity = gravity_term(u0, u1, u2, u3, weight)
            up = vec3(zero, zero, weight)
            g0 += up
            g1 += up
            g2 += up
            g3 += up
        return vec4(v0 * volume, e_gravity, v0 * shape, zero), growth, g0, g1, g2, g3

    @wp.func
    def curvature(elements: elements_type, t: int, u0: vec3, u1: vec3, u2: vec3, u3: vec3, positive: bool):
        """Second derivatives aa, ab, ac, bb, bc, cc in the edge vectors from corner 0."""
        k = 0
        if wp.static(layered):
            k = t
        a = elements.shape_gradient[t, 0]
        b = elements.shape_gradient[t, 1]
        c = elements.shape_gradient[t, 2]
        h = wp.outer(u1 - u0, a) + wp.outer(u2 - u0, b) + wp.outer(u3 - u0, c)
        moduli = elements.moduli[k]
        mu = moduli[0]
        bulk = moduli[1]
        v0 = elements.rest_volume[t]
        cof_h = cofactor(h)
        f = wp.identity(n=3, dtype=scalar) + h
        g = cofactor_of_sum(h, cof_h)
        x = stretch(h)
        j = dilation(h, cof_h)
        across = mu * (scalar(3.0) + x) / (scalar(4.0) + x)
        turn = bulk * pressed(j) - scalar(0.75) * mu
        bulk *= stiffened(j)
        if positive:
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
        return v0 * aa, v0 * ab, v0 * ac, v0 * bb, v0 * bc, v0 * cc

    columns = (VOLUME, GRAVITY, SHAPE) if gravity else (VOLUME, SHAPE)
    return TetFormulas(scalar, fields, elements_type, evaluate, curvature, columns)
