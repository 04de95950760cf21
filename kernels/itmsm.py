"""The energy itmsm of a tetrahedron, eq. 4.6 of [2]: distance, area, volume and gravity terms.

Every term stands beside its gradient and its Hessian. Everything is written on rest vectors and their change, so
that nothing large cancels: a length of 450 mm in float32 carries 3e-5 mm of rounding, a change of it does not. The
kernels are made for one precision and one set of terms; a term that is off is not compiled in."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from .tets import FIRST_TERM, Field, TetFormulas, gravity_term, struct_of, tet_kernels


@wp.func
def relative_norm_change(rest: Any, change: Any, rest_norm: Any):
    """(|rest + change| - rest_norm) / rest_norm, without cancellation."""
    norm = wp.length(rest + change)
    return (wp.dot(rest, change) + wp.dot(rest + change, change)) / (rest_norm * (norm + rest_norm))


@wp.func
def direction_of(v: Any):
    """Unit vector along v, or zero where v is zero: the gradient of |v| that a collapsed feature gets."""
    norm = wp.length(v)
    return wp.where(norm > type(norm)(0.0), v / norm, v - v)


@wp.func
def cross_change(a0: Any, b0: Any, da: Any, db: Any):
    """Change of a x b when a0 and b0 change by da and db."""
    return wp.cross(da, b0 + db) + wp.cross(a0, db)


@wp.func
def relative_volume_change(a0: Any, b0: Any, c0: Any, da: Any, db: Any, dc: Any, rest_volume: Any):
    """(V - V0) / V0 of the tetrahedron of edge vectors a, b, c from one corner (eq. 4.14 of [2])."""
    grown = wp.dot(da, wp.cross(b0 + db, c0 + dc)) + wp.dot(a0, cross_change(b0, c0, db, dc))
    return grown / (type(grown)(6.0) * rest_volume)


@wp.func
def distance_term(rest: Any, change: Any, rest_length: Any, weight: Any):
    """Energy w ((l - l0) / l0)^2 of one edge vector, and its gradient with respect to the vector."""
    stretch = relative_norm_change(rest, change, rest_length)
    force = weight * (stretch + stretch) / rest_length
    return weight * stretch * stretch, force * direction_of(rest + change)


@wp.func
def distance_hessian(rest: Any, change: Any, rest_length: Any, weight: Any, positive: bool):
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
    # a collapsed edge has no direction: it keeps its axial stiffness alone, which is 0 with `direction_of`
    across = wp.where(length > least, type(length)(1.0) - rest_length / length, zero)
    stiffness = (weight + weight) / (rest_length * rest_length)
    identity = wp.identity(n=3, dtype=type(length))
    axial = wp.outer(along, along)
    return stiffness * (axial + across * (identity - axial))


@wp.func
def area_term(a0: Any, b0: Any, da: Any, db: Any, rest_area: Any, weight: Any):
    """Energy w ((A - A0) / A0)^2 of the face spanned by a and b, and its gradient in a and in b."""
    half = type(rest_area)(0.5)
    normal0 = wp.cross(a0, b0)
    change = cross_change(a0, b0, da, db)
    growth = relative_norm_change(normal0, change, rest_area + rest_area)
    normal = direction_of(normal0 + change)
    force = weight * (growth + growth) * half / rest_area
    return weight * growth * growth, force * wp.cross(b0 + db, normal), force * wp.cross(normal, a0 + da)


@wp.func
def area_hessian(a0: Any, b0: Any, da: Any, db: Any, rest_area: Any, weight: Any, positive: bool):
    """Second derivatives (aa, ab, bb) of the area term; where asked for, made positive semidefinite.

    The square of the gradient (Gauss-Newton), and the change of area times the area's own second derivative:
    a part along the normal, which has the sign of the change, and one in the plane, which is indefinite
    (in ab alone, -1/2 skew(normal)). `positive` keeps of these two the first, for a face that has grown.
    """
    half = type(rest_area)(0.5)
    a = a0 + da
    b = b0 + db
    normal = direction_of(wp.cross(a, b))
    ga = half * wp.cross(b, normal)
    gb = half * wp.cross(normal, a)
    stiffness = (weight + weight) / (rest_area * rest_area)
    area = half * wp.length(wp.cross(a, b))
    zero = type(area)(0.0)
    least = rest_area
    in_plane = zero
    if not positive:
        least = zero
        in_plane = half * (area - rest_area)
    tension = wp.where(area > least, (area - rest_area) / (type(area)(4.0) * area), zero)
    out = wp.outer(normal, normal)
    return (
        stiffness * (wp.outer(ga, ga) + (tension * wp.dot(b, b)) * out),
        stiffness * (wp.outer(ga, gb) - (tension * wp.dot(a, b)) * out - in_plane * wp.skew(normal)),
        stiffness * (wp.outer(gb, gb) + (tension * wp.dot(a, a)) * out),
    )


@wp.func
def volume_gradients(a: Any, b: Any, c: Any):
    """Gradient of the signed volume in a, b and c."""
    sixth = type(a[0])(1.0) / type(a[0])(6.0)  # Warp would divide literals in single precision
    return sixth * wp.cross(b, c), sixth * wp.cross(c, a), sixth * wp.cross(a, b)


@wp.func
def volume_term(a0: Any, b0: Any, c0: Any, da: Any, db: Any, dc: Any, rest_volume: Any, weight: Any):
    """Energy w ((V - V0) / V0)^2, and its gradient in a, b and c."""
    growth = relative_volume_change(a0, b0, c0, da, db, dc, rest_volume)
    ga, gb, gc = volume_gradients(a0 + da, b0 + db, c0 + dc)
    force = weight * (growth + growth) / rest_volume
    return weight * growth * growth, force * ga, force * gb, force * gc


DISTANCE, AREA, VOLUME, GRAVITY = range(FIRST_TERM, FIRST_TERM + 4)
"""Columns of its terms."""


@cache
def itmsm_kernels(scalar: type, cuda: bool, area: bool, volume: bool) -> SimpleNamespace:
    """See `tet_kernels`."""
    return tet_kernels(itmsm_formulas(scalar, area, volume), cuda)


@cache
def itmsm_formulas(scalar: type, area: bool, volume: bool) -> TetFormulas:
    """Energy and Hessian of distances, gravity and the given terms; `scalar` is their precision."""
    vec3, vec4, vec6 = (wp.types.vector(size, scalar) for size in (3, 4, 6))
    zero = wp.constant(scalar(0.0))
    epsilon_term, theta_term = area, volume
    fields = {
        "rest_edge": Field(vec3, 3),
        "rest_length": Field(vec6),
        "rest_area": Field(vec4),
        "rest_volume": Field(scalar),
        "edge_weight": Field(vec6),
        "face_weight": Field(vec4),
        "theta": Field(scalar),
        "gravity_weight": Field(scalar),
    }
    elements_type = struct_of(fields)

    @wp.func
    def evaluate(elements: elements_type, t: int, u0: vec3, u1: vec3, u2: vec3, u3: vec3):
        """Energies by term, relative change of volume, and the gradients of the four corners."""
        length = elements.rest_length[t]
        w = elements.edge_weight[t]
        v0 = elements.rest_volume[t]
        a0 = elements.rest_edge[t, 0]
        b0 = elements.rest_edge[t, 1]
        c0 = elements.rest_edge[t, 2]
        e_area = zero
        e_volume = zero
        da = u1 - u0
        db = u2 - u0
        dc = u3 - u0
        e01, f01 = distance_term(a0, da, length[0], w[0])
        e02, f02 = distance_term(b0, db, length[1], w[1])
        e03, f03 = distance_term(c0, dc, length[2], w[2])
        e12, f12 = distance_term(b0 - a0, db - da, length[3], w[3])
        e13, f13 = distance_term(c0 - a0, dc - da, length[4], w[4])
        e23, f23 = distance_term(c0 - b0, dc - db, length[5], w[5])
        e_distance = e01 + e02 + e03 + e12 + e13 + e23
        ga = f01 - f12 - f13
        gb = f02 + f12 - f23
        gc = f03 + f13 + f23
        growth = relative_volume_change(a0, b0, c0, da, db, dc, v0)
        if wp.static(theta_term):
            e_volume, va, vb, vc = volume_term(a0, b0, c0, da, db, dc, v0, elements.theta[t])
            ga += va
            gb += vb
            gc += vc
        if wp.static(epsilon_term):
            s = elements.rest_area[t]
            v = elements.face_weight[t]
            e_012, p_a, p_b = area_term(a0, b0, da, db, s[3], v[3])
            e_013, q_a, q_c = area_term(a0, c0, da, dc, s[2], v[2])
            e_023, r_b, r_c = area_term(b0, c0, db, dc, s[1], v[1])
            e_123, s_b, s_c = area_term(b0 - a0, c0 - a0, db - da, dc - da, s[0], v[0])
            e_area = e_012 + e_013 + e_023 + e_123
            ga += p_a + q_a - s_b - s_c
            gb += p_b + r_b + s_b
            gc += q_c + r_c + s_c
        weight = elements.gravity_weight[t] * v0
        e_gravity = gravity_term(u0, u1, u2, u3, weight)
        up = vec3(zero, zero, weight)
        g0 = up - (ga + gb + gc)
        return vec4(e_distance, e_area, e_volume, e_gravity), growth, g0, ga + up, gb + up, gc + up

    @wp.func
    def hessian(elements: elements_type, t: int, u0: vec3, u1: vec3, u2: vec3, u3: vec3, positive: bool):
        """Second derivatives aa, ab, ac, bb, bc, cc in the edge vectors from corner 0."""
        length = elements.rest_length[t]
        w = elements.edge_weight[t]
        v0 = elements.rest_volume[t]
        a0 = elements.rest_edge[t, 0]
        b0 = elements.rest_edge[t, 1]
        c0 = elements.rest_edge[t, 2]
        da = u1 - u0
        db = u2 - u0
        dc = u3 - u0
        k01 = distance_hessian(a0, da, length[0], w[0], positive)
        k02 = distance_hessian(b0, db, length[1], w[1], positive)
        k03 = distance_hessian(c0, dc, length[2], w[2], positive)
        k12 = distance_hessian(b0 - a0, db - da, length[3], w[3], positive)
        k13 = distance_hessian(c0 - a0, dc - da, length[4], w[4], positive)
        k23 = distance_hessian(c0 - b0, dc - db, length[5], w[5], positive)
        aa = k01 + k12 + k13
        bb = k02 + k12 + k23
        cc = k03 + k13 + k23
        ab = -k12
        ac = -k13
        bc = -k23
        if wp.static(theta_term):
            ga, gb, gc = volume_gradients(a0 + da, b0 + db, c0 + dc)
            stiffness = (elements.theta[t] + elements.theta[t]) / (v0 * v0)
            aa += stiffness * wp.outer(ga, ga)
            bb += stiffness * wp.outer(gb, gb)
            cc += stiffness * wp.outer(gc, gc)
            ab += stiffness * wp.outer(ga, gb)
            ac += stiffness * wp.outer(ga, gc)
            bc += stiffness * wp.outer(gb, gc)
            if not positive:
                growth = relative_volume_change(a0, b0, c0, da, db, dc, v0)
                turn = stiffness * growth * v0 / scalar(6.0)
                ab -= turn * wp.skew(c0 + dc)
                ac += turn * wp.skew(b0 + db)
                bc -= turn * wp.skew(a0 + da)
        if wp.static(epsilon_term):
            s = elements.rest_area[t]
            v = elements.face_weight[t]
            p_aa, p_ab, p_bb = area_hessian(a0, b0, da, db, s[3], v[3], positive)
            q_aa, q_ac, q_cc = area_hessian(a0, c0, da, dc, s[2], v[2], positive)
            r_bb, r_bc, r_cc = area_hessian(b0, c0, db, dc, s[1], v[1], positive)
            s_bb, s_bc, s_cc = area_hessian(b0 - a0, c0 - a0, db - da, dc - da, s[0], v[0], positive)
            s_cb = wp.transpose(s_bc)
            aa += p_aa + q_aa + s_bb + s_bc + s_cb + s_cc
            bb += p_bb + r_bb + s_bb
            cc += q_cc + r_cc + s_cc
            ab += p_ab - s_bb - s_cb
            ac += q_ac - s_bc - s_cc
            bc += r_bc + s_bc
        return aa, ab, ac, bb, bc, cc

    columns = (DISTANCE, *[AREA] * area, *[VOLUME] * volume, GRAVITY)
    name = f"itmsm_{scalar.__name__}{'_area' * area}{'_volume' * volume}"
    return TetFormulas(name, scalar, fields, elements_type, evaluate, hessian, columns)
