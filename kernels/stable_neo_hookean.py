"""Stable neo-Hookean elasticity of a deformation gradient F, written on H = F - I so that nothing cancels at rest.

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
"""

from typing import Any

import warp as wp

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
    one = type(h[0, 0])(1.0)
    return (one + wp.trace(h)) * wp.identity(n=3, dtype=type(h[0, 0])) - wp.transpose(h) + cofactor_h


@wp.func
def crushed(j: Any):
    """How much smaller than CRUSHED det F = 1 + j is."""
    return wp.max(type(j)(CRUSHED) - type(j)(1.0) - j, type(j)(0.0))


@wp.func
def pressed(j: Any):
    """The derivative of j^2 / 2 + `resistance`, which lambda cof F has as a factor in the stress."""
    short = crushed(j)
    bent = wp.min(short, type(j)(STIFFENS))
    return j - type(j)(CRUSH) * bent * bent * (bent + type(j)(3.0) * (short - bent))


@wp.func
def stiffened(j: Any):
    """The derivative of `pressed`."""
    bent = wp.min(crushed(j), type(j)(STIFFENS))
    return type(j)(1.0) + type(j)(3.0 * CRUSH) * bent * bent


@wp.func
def resistance(j: Any):
    """The energy that resists crushing, over lambda and per rest volume."""
    short = crushed(j)
    bent = wp.min(short, type(j)(STIFFENS))
    over = short - bent
    squares = bent * bent + type(j)(4.0) * bent * over + type(j)(6.0) * over * over
    return type(j)(0.25 * CRUSH) * bent * bent * squares


@wp.func
def neo_hookean(h: Any, mu: Any, bulk: Any):
    """Energies of shape (the terms in mu) and of volume (lambda) per rest volume, and the first Piola stress P.

    P = 3/4 mu (F - cof F) + mu x / (4 (4 + x)) F + lambda j cof F with x = |F|^2 - 3, which vanishes with H; where
    tissue is crushed, `pressed` stands for j.
    `bulk` is the paper's lambda, a word that Python keeps for itself.
    """
    half = type(mu)(0.5)
    quarter = type(mu)(0.25)
    cof = cofactor(h)
    x = stretch(h)
    j = dilation(h, cof)
    second_order = half * wp.ddot(h, h) - wp.trace(cof) - wp.dot(h[0], cof[0])
    y = wp.float64(quarter * x)
    barrier = type(mu)(y - wp.log(wp.float64(1.0) + y))
    shape = mu * (type(mu)(0.75) * second_order + half * barrier)
    identity = wp.identity(n=3, dtype=type(mu))
    shear = h + wp.transpose(h) - wp.trace(h) * identity - cof
    tension = mu * quarter * x / (type(mu)(4.0) + x)
    stress = type(mu)(0.75) * mu * shear + tension * (identity + h) + bulk * pressed(j) * cofactor_of_sum(h, cof)
    volume = bulk * (half * j * j + resistance(j))
    return shape, volume, stress, j


@wp.func
def bounded_turn(c: Any, bulk: Any, turn: Any, h: Any, x: Any, j: Any):
    """The factor `turn` of the second derivative of det F, no larger than keeps the whole curvature positive.

    The curvature is c I + 2 mu / (|F|^2 + 1)^2 F F + lambda cof F cof F + turn T. T, the second derivative of
    det F, has the eigenvalues +-s for each principal stretch s and the three roots e of e^3 - |F|^2 e - 2 det F
    (Smith, de Goes and Kim: Analytic eigensystems for isotropic distortion energies. ACM Trans. Graph. 38, 2019).
    For turn > 0 the least root binds. For turn < 0 the largest stretch binds, and the largest root is held by
    lambda as long as -turn <= 3/2 lambda det F: det F T + diag(g^2) = g g on the principal axes, g = cof F.
    """
    third = type(c)(1.0) / type(c)(3.0)
    tiny = type(c)(1.0e-20)
    squared = third * (type(c)(3.0) + x)
    root = wp.sqrt(wp.max(squared, tiny))
    angle = third * safe_acos((type(c)(1.0) + j) / (root * root * root))
    least_root = -root * (wp.cos(angle) + wp.sqrt(type(c)(3.0)) * wp.sin(angle))
    largest_root = (root + root) * wp.cos(angle)
    bound = c / largest_root
    held = wp.min(c / largest_stretch(h, squared), type(c)(1.5) * bulk * (type(c)(1.0) + j))
    return wp.where(turn > type(c)(0.0), wp.min(turn, -c / least_root), -wp.min(-turn, wp.max(bound, held)))


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
    one = type(cosine)(1.0)
    return wp.acos(wp.clamp(cosine, -one, one))
