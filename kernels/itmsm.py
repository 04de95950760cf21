"""The energy itmsm, eq. 4.6 of [2], of a tetrahedron: energy with gradient, and curvature.

They are made for one precision and one set of terms; a term that is off is not compiled in.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .area import area_curvature, area_term
from .distance import distance_curvature, distance_term
from .elements import FIRST_TERM
from .formulas import Field, TetFormulas, struct_of
from .geometry import relative_volume_change
from .gravity import gravity_term
from .tet_kernels import tet_kernels
from .volume import volume_gradients, volume_term

DISTANCE, AREA, VOLUME, GRAVITY = range(FIRST_TERM, FIRST_TERM + 4)
"""Columns of its terms."""


@cache
def itmsm_kernels(
    scalar: type, cuda: bool, layered: bool, gravity: bool, area: bool, volume: bool
) -> SimpleNamespace:
    """See `tet_kernels`."""
    return tet_kernels(itmsm_formulas(scalar, layered, gravity, area, volume), cuda)


@cache
def itmsm_formulas(scalar: type, layered: bool, gravity: bool, area: bool, volume: bool) -> TetFormulas:
    """Energy and curvature of the given terms.

    `scalar` is their precision. `layered` tissue has a theta and a gravity weight for each tetrahedron, uniform
    tissue one for all.
    """
    vec3, vec4, vec6 = (wp.types.vector(size, scalar) for size in (3, 4, 6))
    zero = wp.constant(scalar(0.0))
    epsilon_term, theta_term, gravity_on = area, volume, gravity
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
        k = 0
        if wp.static(layered):
            k = t
        length = elements.rest_length[t]
        w = elements.edge_weight[t]
        v0 = elements.rest_volume[t]
        a0 = elements.rest_edge[t, 0]
        b0 = elements.rest_edge[t, 1]
        c0 = elements.rest_edge[t, 2]
        e_area = zero
        e_volume = zero
        e_gravity = zero
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
            e_volume, va, vb, vc = volume_term(a0, b0, c0, da, db, dc, v0, elements.theta[k])
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
        g0 = -(ga + gb + gc)
        if wp.static(gravity_on):
            weight = elements.gravity_weight[k] * v0
            e_gravity = gravity_term(u0, u1, u2, u3, weight)
            up = vec3(zero, zero, weight)
            g0 += up
            ga += up
            gb += up
            gc += up
        return vec4(e_distance, e_area, e_volume, e_gravity), growth, g0, ga, gb, gc

    @wp.func
    def curvature(elements: elements_type, t: int, u0: vec3, u1: vec3, u2: vec3, u3: vec3, positive: bool):
        """Second derivatives aa, ab, ac, bb, bc, cc in the edge vectors from corner 0."""
        k = 0
        if wp.static(layered):
            k = t
        length = elements.rest_length[t]
        w = elements.edge_weight[t]
        v0 = elements.rest_volume[t]
        a0 = elements.rest_edge[t, 0]
        b0 = elements.rest_edge[t, 1]
        c0 = elements.rest_edge[t, 2]
        da = u1 - u0
        db = u2 - u0
        dc = u3 - u0
        k01 = distance_curvature(a0, da, length[0], w[0], positive)
        k02 = distance_curvature(b0, db, length[1], w[1], positive)
        k03 = distance_curvature(c0, dc, length[2], w[2], positive)
        k12 = distance_curvature(b0 - a0, db - da, length[3], w[3], positive)
        k13 = distance_curvature(c0 - a0, dc - da, length[4], w[4], positive)
        k23 = distance_curvature(c0 - b0, dc - db, length[5], w[5], positive)
        aa = k01 + k12 + k13
        bb = k02 + k12 + k23
        cc = k03 + k13 + k23
        ab = -k12
        ac = -k13
        bc = -k23
        if wp.static(theta_term):
            ga, gb, gc = volume_gradients(a0 + da, b0 + db, c0 + dc)
            stiffness = (elements.theta[k] + elements.theta[k]) / (v0 * v0)
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
            p_aa, p_ab, p_bb = area_curvature(a0, b0, da, db, s[3], v[3], positive)
            q_aa, q_ac, q_cc = area_curvature(a0, c0, da, dc, s[2], v[2], positive)
            r_bb, r_bc, r_cc = area_curvature(b0, c0, db, dc, s[1], v[1], positive)
            s_bb, s_bc, s_cc = area_curvature(b0 - a0, c0 - a0, db - da, dc - da, s[0], v[0], positive)
            s_cb = wp.transpose(s_bc)
            aa += p_aa + q_aa + s_bb + s_bc + s_cb + s_cc
            bb += p_bb + r_bb + s_bb
            cc += q_cc + r_cc + s_cc
            ab += p_ab - s_bb - s_cb
            ac += q_ac - s_bc - s_cc
            bc += r_bc + s_bc
        return aa, ab, ac, bb, bc, cc

    on = {DISTANCE: True, AREA: area, VOLUME: volume, GRAVITY: gravity}
    return TetFormulas(scalar, fields, elements_type, evaluate, curvature, tuple(c for c in on if on[c]))
