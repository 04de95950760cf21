"""Bending of the skin: the change of the angle between neighbouring skin triangles, of each a spring.

A hinge is two triangles on one edge: corners 0 and 1 are the edge, 2 and 3 the others. Gradient and second
derivatives of the angle as in Tamstorf and Grinspun, Discrete bending forces and their Jacobians (Graphical Models
2013), written on the edge vectors a, b, c from corner 0 to 1, 2, 3.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from .arguments import Corners, Items, Sums, array_types
from .assembly import BENDING, Places, add_gradient, block_sums_type, hessian_adder
from .vectors import add_sum


@wp.func
def edges_of(h: int, n: wp.vec4i, rest_edge: wp.array2d[Any], displacement: wp.array[Any]):
    """Vectors from corner 0 of a hinge to the others."""
    u = displacement[n[0]]
    return (
        rest_edge[h, 0] + (displacement[n[1]] - u),
        rest_edge[h, 1] + (displacement[n[2]] - u),
        rest_edge[h, 2] + (displacement[n[3]] - u),
    )


@wp.func
def hinge_angle(a: Any, b: Any, c: Any):
    """Angle between the normals of the triangles 0 1 2 and 1 0 3, positive where they fold away from them."""
    n = wp.cross(a, b)
    m = wp.cross(c, a)
    return wp.atan2(wp.dot(wp.cross(n, m), a), wp.length(a) * wp.dot(n, m))


@wp.func
def over_square(v: Any):
    """v / |v|^2, zero where v is zero."""
    square = wp.dot(v, v)
    if square > type(square)(0.0):  # a triangle without area has no normal to turn
        return v / square
    return v - v


@wp.func
def hinge_gradient(a: Any, b: Any, c: Any):
    """Gradient of the angle in a, b and c."""
    length = wp.length(a)
    gb = -length * over_square(wp.cross(a, b))
    gc = -length * over_square(wp.cross(c, a))
    along = over_square(a)
    return -(wp.dot(along, b) * gb + wp.dot(along, c) * gc), gb, gc


@wp.func
def over_square_derivative(n: Any):
    """Derivative of n / |n|^2 in n, zero where n is zero."""
    square = wp.dot(n, n)
    identity = wp.identity(n=3, dtype=type(square))
    if square > type(square)(0.0):
        return (identity - (wp.outer(n, n) + wp.outer(n, n)) / square) / square
    return identity - identity


@wp.func
def hinge_hessian(a: Any, b: Any, c: Any):
    """Second derivatives (aa, ab, ac, bb, cc) of the angle; bc vanishes."""
    length = wp.length(a)
    n = wp.cross(a, b)
    m = wp.cross(c, a)
    gb = -length * over_square(n)
    gc = -length * over_square(m)
    along = over_square(a)
    of_b = wp.dot(along, b)
    of_c = wp.dot(along, c)
    dn = length * over_square_derivative(n)
    dm = length * over_square_derivative(m)
    bb = -dn * wp.skew(a)
    cc = dm * wp.skew(a)
    ba = wp.outer(gb, along) + dn * wp.skew(b)
    ca = wp.outer(gc, along) - dm * wp.skew(c)
    square = wp.dot(along, along)
    db = b * square - (of_b + of_b) * along
    dc = c * square - (of_c + of_c) * along
    aa = -(wp.outer(gb, db) + of_b * ba + wp.outer(gc, dc) + of_c * ca)
    return aa, wp.transpose(ba), wp.transpose(ca), bb, cc


@wp.func
def angle_change(angle: Any, rest_angle: Any):
    """By how much an angle is larger than at rest, from -pi to pi."""
    turn = type(angle)(wp.static(2.0 * wp.pi))
    change = angle - rest_angle
    return change - turn * wp.round(change / turn)


@cache
def skin_bending_kernels(scalar: type, cuda: bool) -> SimpleNamespace:
    """The kernels `gradient`, `projected_hessian` (made positive) and `hessian` in one precision."""
    add_hessian, blocks_type = hessian_adder(scalar, cuda), block_sums_type(scalar, cuda)
    Numbers, Vectors, _ = array_types(scalar)
    Edges = Slabs = wp.array2d[wp.types.vector(3, scalar)]
    module = f"skin_bending_{scalar.__name__}_{'cuda' if cuda else 'cpu'}"

    @wp.kernel(module=module, enable_backward=False)
    def gradient(
        items: Items,
        hinges: Corners,
        rest_edge: Edges,
        rest_angle: Numbers,
        stiffness: Numbers,
        displacement: Vectors,
        gradient: Slabs,
        sums: Sums,
    ):
        h = items.first + wp.tid()
        energy = scalar(0.0)
        if h < items.end:
            n = hinges[h]
            a, b, c = edges_of(h, n, rest_edge, displacement)
            change = angle_change(hinge_angle(a, b, c), rest_angle[h])
            energy = stiffness[h] * change * change
            moment = (stiffness[h] + stiffness[h]) * change
            ga, gb, gc = hinge_gradient(a, b, c)
            add_gradient(gradient, items.slab, n, -moment * (ga + gb + gc), moment * ga, moment * gb, moment * gc)
        add_sum(sums, items.slab, BENDING, wp.float64(energy))

    def make_hessian(positive: bool) -> wp.Kernel:
        @wp.kernel(module=module, enable_backward=False)
        def hessian(
            items: Items,
            hinges: Corners,
            rest_edge: Edges,
            rest_angle: Numbers,
            stiffness: Numbers,
            tets: int,
            place_of: Places,
            displacement: Vectors,
            blocks: blocks_type,
        ):
            item = items.first + wp.tid()
            h = wp.min(item, items.end - 1)  # all threads of a warp store together, those past the end as well
            a, b, c = edges_of(h, hinges[h], rest_edge, displacement)
            k = stiffness[h] + stiffness[h]
            ga, gb, gc = hinge_gradient(a, b, c)
            aa = k * wp.outer(ga, ga)
            ab = k * wp.outer(ga, gb)
            ac = k * wp.outer(ga, gc)
            bb = k * wp.outer(gb, gb)
            bc = k * wp.outer(gb, gc)
            cc = k * wp.outer(gc, gc)
            if not wp.static(positive):  # what the angle's own second derivative adds is indefinite
                moment = k * angle_change(hinge_angle(a, b, c), rest_angle[h])
                t_aa, t_ab, t_ac, t_bb, t_cc = hinge_hessian(a, b, c)
                aa += moment * t_aa
                ab += moment * t_ab
                ac += moment * t_ac
                bb += moment * t_bb
                cc += moment * t_cc
            add_hessian(blocks, tets + item, tets + h, place_of, aa, ab, ac, bb, bc, cc)

        return hessian

    return SimpleNamespace(
        gradient=gradient, projected_hessian=make_hessian(positive=True), hessian=make_hessian(positive=False)
    )
