"""The stable neo-Hookean energy of a linear tetrahedron: energy with gradient, and Hessian.

It is written on H = F - I of the deformation gradient F, so that nothing cancels at rest:

    psi = mu/2 (|F|^2 - 3) + lambda/2 (det F - alpha)^2 - mu/2 log(|F|^2 + 1) + constant

with alpha = 1 + 3 mu / (4 lambda) (Smith, de Goes and Kim: Stable neo-Hookean flesh simulation. ACM Trans. Graph.
37, 2018, eq. 14); zero at rest, and defined for every F, turned inside out as well. With j = det F - 1
and y = (|F|^2 - 3) / 4 it is

    psi = 3/4 mu (|F|^2 / 2 - 3/2 - j) + mu/2 (y - log(1 + y)) + lambda/2 j^2

whose first bracket is |H|^2 / 2 - tr cof H - det H: all that is left is of second order in H.

That energy stays finite where a volume vanishes, so that tetrahedra beside rigid bones come to rest flat or inside
out. One that has less than half of its volume is held by lambda CRUSH / 4 (1/2 - det F)^4 more, which begins with
no force and no stiffness. Below det F = 1/5 it goes on with the stiffness that it has there, 433 lambda: where
stiffness grows without limit, Newton's steps leave two thirds of the way each.

Kernels are made for one precision.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from .tets import FIRST_TERM, Field, TetFormulas, gravity_term, struct_of, tet_kernels

CRUSHED = wp.constant(0.5)
"""The det F below which tissue is stiffer."""
CRUSH = wp.constant(1600.0)
"""How much stiffer: d = CRUSHED - det F adds the pressure CRUSH d^3, in units of lambda."""
STIFFENS = wp.constant(0.3)
"""The d up to which stiffness grows."""


@wp.func
def cofactor(m: Any):
    """Derivative of det m: rows are the cross products of the other two rows."""
    return wp.matrix_from_rows(wp.cross(m[1], m[2]), wp.cross(m[2], m[0]), wp.cross(m[0], m[1]))


@wp.func
def stretch(h: Any):
    """|F|^2 - 3 of F = I + H."""
    return wp.trace(h) + wp.trace(h) + wp.ddot(h, h)


@wp.func
def dilation(h: Any, cofactor_h: Any):
    """det F - 1 of F = I + H."""
    return wp.trace(h) + wp.trace(cofactor_h) + wp.dot(h[0], cofactor_h[0])


@wp.func
def cofactor_of_sum(h: Any, cofactor_h: Any):
    """The cofactor of F = I + H."""
    unity = type(h[0, 0])(1.0)
    return (unity + wp.trace(h)) * wp.identity(n=3, dtype=type(h[0, 0])) - wp.transpose(h) + cofactor_h


@wp.func
def crushing_depth(j: Any):
    """How much smaller than CRUSHED det F = 1 + j is."""
    return wp.max(type(j)(CRUSHED) - type(j)(1.0) - j, type(j)(0.0))


@wp.func
def volumetric_pressure(j: Any):
    """The derivative of j^2 / 2 + `crushing_energy`, which lambda cof F has as a factor in the stress."""
    short = crushing_depth(j)
    stiffening = wp.min(short, type(j)(STIFFENS))
    return j - type(j)(CRUSH) * stiffening * stiffening * (stiffening + type(j)(3.0) * (short - stiffening))


@wp.func
def volumetric_stiffness(j: Any):
    """The derivative of `volumetric_pressure`."""
    stiffening = wp.min(crushing_depth(j), type(j)(STIFFENS))
    return type(j)(1.0) + type(j)(3.0 * CRUSH) * stiffening * stiffening


@wp.func
def crushing_energy(j: Any):
    """The energy that resists crushing, over lambda and per rest volume."""
    short = crushing_depth(j)
    stiffening = wp.min(short, type(j)(STIFFENS))
    over = short - stiffening
    squares = stiffening * stiffening + type(j)(4.0) * stiffening * over + type(j)(6.0) * over * over
    return type(j)(0.25 * CRUSH) * stiffening * stiffening * squares


@wp.func
def neo_hookean(h: Any, mu: Any, bulk: Any):
    """Energies of shape (the terms in mu) and of volume (lambda) per rest volume, and the first Piola stress P.

    P = 3/4 mu (F - cof F) + mu x / (4 (4 + x)) F + lambda j cof F with x = |F|^2 - 3, which vanishes with H; where
    tissue is crushed, `volumetric_pressure` stands for j.
    `bulk` is the paper's lambda, a word that Python keeps for itself.
    """
    half = type(mu)(0.5)
    quarter = type(mu)(0.25)
    cof = cofactor(h)
    x = stretch(h)
    j = dilation(h, cof)
    second_order = half * wp.ddot(h, h) - wp.trace(cof) - wp.dot(h[0], cof[0])
    y = wp.float64(quarter * x)  # in float32 y - log(1 + y) would have no digits near rest
    barrier = type(mu)(y - wp.log(wp.float64(1.0) + y))
    shape = mu * (type(mu)(0.75) * second_order + half * barrier)
    identity = wp.identity(n=3, dtype=type(mu))
    shear = h + wp.transpose(h) - wp.trace(h) * identity - cof
    tension = mu * quarter * x / (type(mu)(4.0) + x)
    stress = (
        type(mu)(0.75) * mu * shear
        + tension * (identity + h)
        + bulk * volumetric_pressure(j) * cofactor_of_sum(h, cof)
    )
    volume = bulk * (half * j * j + crushing_energy(j))
    return shape, volume, stress, j


@wp.func
def bounded_pressure(c: Any, bulk: Any, pressure: Any, h: Any, x: Any, j: Any):
    """The factor `pressure` of the second derivative of det F, no larger than keeps the whole curvature positive.

    The curvature is c I + 2 mu / (|F|^2 + 1)^2 F F + lambda cof F cof F + pressure T. T, the second derivative of
    det F, has the eigenvalues +-s for each principal stretch s and the three roots e of e^3 - |F|^2 e - 2 det F
    (Smith, de Goes and Kim: Analytic eigensystems for isotropic distortion energies. ACM Trans. Graph. 38, 2019).
    For pressure > 0 the least root binds. For pressure < 0 the largest stretch binds, and the largest root is held
    by lambda as long as -pressure <= 3/2 lambda det F: det F T + diag(g^2) = g g on the principal axes, g = cof F.
    """
    third = type(c)(1.0) / type(c)(3.0)
    tiny = type(c)(1.0e-20)  # a tetrahedron shrunk to a point has no root to divide by
    squared = third * (type(c)(3.0) + x)
    root = wp.sqrt(wp.max(squared, tiny))
    angle = third * safe_acos((type(c)(1.0) + j) / (root * root * root))
    least_root = -root * (wp.cos(angle) + wp.sqrt(type(c)(3.0)) * wp.sin(angle))
    largest_root = (root + root) * wp.cos(angle)
    bound = c / largest_root
    held = wp.min(c / largest_stretch(h, squared), type(c)(1.5) * bulk * (type(c)(1.0) + j))
    return wp.where(
        pressure > type(c)(0.0), wp.min(pressure, -c / least_root), -wp.min(-pressure, wp.max(bound, held))
    )


@wp.func
def largest_stretch(h: Any, mean_squared: Any):
    """The largest principal stretch of F = I + H, whose squares have the given mean."""
    f = wp.identity(n=3, dtype=type(mean_squared)) + h
    away = wp.transpose(f) * f - mean_squared * wp.identity(n=3, dtype=type(mean_squared))
    spread = wp.sqrt(wp.ddot(away, away) / type(mean_squared)(6.0)) + type(mean_squared)(1.0e-20)
    normal = away / spread
    angle = safe_acos(type(mean_squared)(0.5) * wp.determinant(normal)) / type(mean_squared)(3.0)
    return wp.sqrt(mean_squared + (spread + spread) * wp.cos(angle))


@wp.func
def safe_acos(cosine: Any):
    """acos of a value that rounding may have carried past 1."""
    unity = type(cosine)(1.0)
    return wp.acos(wp.clamp(cosine, -unity, unity))


VOLUME, GRAVITY, SHAPE = range(FIRST_TERM, FIRST_TERM + 3)
"""Columns of its terms."""


@wp.func
def hessian_block(c: Any, f_weight: Any, bulk: Any, f: Any, g: Any, a: Any, b: Any):
    """Second derivative in the edge vectors of shape gradients a and b per rest volume, but for the pressure."""
    identity = wp.identity(n=3, dtype=type(c))
    return c * wp.dot(a, b) * identity + f_weight * wp.outer(f * a, f * b) + bulk * wp.outer(g * a, g * b)


@cache
def neo_hookean_kernels(scalar: type, cuda: bool) -> SimpleNamespace:
    """See `tet_kernels`."""
    return tet_kernels(neo_hookean_formulas(scalar), cuda)


@cache
def neo_hookean_formulas(scalar: type) -> TetFormulas:
    """Energy and curvature in one precision."""
    vec2, vec3, vec4 = (wp.types.vector(size, scalar) for size in (2, 3, 4))
    zero = wp.constant(scalar(0.0))
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
        a = elements.shape_gradient[t, 0]
        b = elements.shape_gradient[t, 1]
        c = elements.shape_gradient[t, 2]
        h = wp.outer(u1 - u0, a) + wp.outer(u2 - u0, b) + wp.outer(u3 - u0, c)
        moduli = elements.moduli[t]
        v0 = elements.rest_volume[t]
        shape, volume, stress, growth = neo_hookean(h, moduli[0], moduli[1])
        stress = v0 * stress
        g1 = stress * a
        g2 = stress * b
        g3 = stress * c
        weight = elements.gravity_weight[t] * v0
        e_gravity = gravity_term(u0, u1, u2, u3, weight)
        up = vec3(zero, zero, weight)
        g0 = up - (g1 + g2 + g3)
        return vec4(v0 * volume, e_gravity, v0 * shape, zero), growth, g0, g1 + up, g2 + up, g3 + up

    @wp.func
    def hessian(elements: elements_type, t: int, u0: vec3, u1: vec3, u2: vec3, u3: vec3, positive: bool):
        """Second derivatives aa, ab, ac, bb, bc, cc in the edge vectors from corner 0."""
        a = elements.shape_gradient[t, 0]
        b = elements.shape_gradient[t, 1]
        c = elements.shape_gradient[t, 2]
        h = wp.outer(u1 - u0, a) + wp.outer(u2 - u0, b) + wp.outer(u3 - u0, c)
        moduli = elements.moduli[t]
        mu = moduli[0]
        bulk = moduli[1]
        v0 = elements.rest_volume[t]
        cof_h = cofactor(h)
        f = wp.identity(n=3, dtype=scalar) + h
        g = cofactor_of_sum(h, cof_h)
        x = stretch(h)
        j = dilation(h, cof_h)
        across = mu * (scalar(3.0) + x) / (scalar(4.0) + x)
        pressure = bulk * volumetric_pressure(j) - scalar(0.75) * mu
        bulk *= volumetric_stiffness(j)
        if positive:  # all else in the curvature is positive; see there
            pressure = bounded_pressure(across, bulk, pressure, h, x, j)
        along = (mu + mu) / ((scalar(4.0) + x) * (scalar(4.0) + x))
        ab_turn = -pressure * wp.skew(f * wp.cross(a, b))
        bc_turn = -pressure * wp.skew(f * wp.cross(b, c))
        ca_turn = -pressure * wp.skew(f * wp.cross(c, a))
        aa = hessian_block(across, along, bulk, f, g, a, a)
        bb = hessian_block(across, along, bulk, f, g, b, b)
        cc = hessian_block(across, along, bulk, f, g, c, c)
        ab = hessian_block(across, along, bulk, f, g, a, b) + ab_turn
        bc = hessian_block(across, along, bulk, f, g, b, c) + bc_turn
        ac = hessian_block(across, along, bulk, f, g, a, c) - ca_turn
        return v0 * aa, v0 * ab, v0 * ac, v0 * bb, v0 * bc, v0 * cc

    columns = (VOLUME, GRAVITY, SHAPE)
    return TetFormulas(f"neo_hookean_{scalar.__name__}", scalar, fields, elements_type, evaluate, hessian, columns)
