"""The energy itmsm, eq. 4.6 of [2], over tetrahedra: energy with gradient, and curvature, each one kernel.

A kernel is made for one precision and one set of terms; a term that is off is not compiled in.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .area import area_curvature, area_term
from .distance import distance_curvature, distance_term
from .elements import (
    FIRST_TERM,
    INVERTED,
    NEWLY_INVERTED,
    add_gradient,
    curvature_adder,
    sums_of_blocks,
    vec16i,
)
from .geometry import relative_volume_change
from .gravity import gravity_term
from .reduction import adder
from .volume import volume_gradients, volume_term

DISTANCE, AREA, VOLUME, GRAVITY = range(FIRST_TERM, FIRST_TERM + 4)
"""Columns of its terms."""


@cache
def itmsm_kernels(
    scalar: type, cuda: bool, layered: bool, gravity: bool, area: bool, volume: bool
) -> SimpleNamespace:
    """The kernels `gradient`, `curvature` (made positive) and `true_curvature` of the given terms.

    `scalar` is their precision. `layered` tissue has a theta and a gravity weight for each tetrahedron, uniform
    tissue one for all.
    """
    add, add_curvature, blocks_type = adder(cuda), curvature_adder(scalar, cuda), sums_of_blocks(scalar, cuda)
    vec3 = wp.types.vector(3, scalar)
    vec4 = wp.types.vector(4, scalar)
    vec6 = wp.types.vector(6, scalar)
    zero = wp.constant(scalar(0.0))
    epsilon_term, theta_term, gravity_on = area, volume, gravity

    @wp.kernel(module="unique", enable_backward=False)
    def gradient_kernel(
        first: int,
        end: int,
        slab: int,
        tets: wp.array(dtype=wp.vec4i),
        rest_edge: wp.array(dtype=vec3, ndim=2),
        rest_length: wp.array(dtype=vec6),
        rest_area: wp.array(dtype=vec4),
        rest_volume: wp.array(dtype=scalar),
        edge_weight: wp.array(dtype=vec6),
        face_weight: wp.array(dtype=vec4),
        theta: wp.array(dtype=scalar),
        gravity_weight: wp.array(dtype=scalar),
        inverted_before: wp.array(dtype=wp.int8),
        displacement: wp.array(dtype=vec3),
        gradient: wp.array(dtype=vec3, ndim=2),
        inverted: wp.array(dtype=wp.int8),
        sums: wp.array(dtype=wp.float64, ndim=2),
    ):
        t = first + wp.tid()
        e_distance = zero
        e_area = zero
        e_volume = zero
        e_gravity = zero
        is_inverted = wp.int32(0)
        is_new = wp.int32(0)
        if t < end:
            n = tets[t]
            k = 0
            if wp.static(layered):
                k = t
            a0 = rest_edge[t, 0]
            b0 = rest_edge[t, 1]
            c0 = rest_edge[t, 2]
            u0 = displacement[n[0]]
            u1 = displacement[n[1]]
            u2 = displacement[n[2]]
            u3 = displacement[n[3]]
            da = u1 - u0
            db = u2 - u0
            dc = u3 - u0
            length = rest_length[t]
            w = edge_weight[t]
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
            v0 = rest_volume[t]
            growth = relative_volume_change(a0, b0, c0, da, db, dc, v0)
            if wp.static(theta_term):
                e_volume, va, vb, vc = volume_term(a0, b0, c0, da, db, dc, v0, theta[k])
                ga += va
                gb += vb
                gc += vc
            if wp.static(epsilon_term):
                s = rest_area[t]
                v = face_weight[t]
                e_012, p_a, p_b = area_term(a0, b0, da, db, s[3], v[3])
                e_013, q_a, q_c = area_term(a0, c0, da, dc, s[2], v[2])
                e_023, r_b, r_c = area_term(b0, c0, db, dc, s[1], v[1])
                e_123, s_b, s_c = area_term(b0 - a0, c0 - a0, db - da, dc - da, s[0], v[0])
                e_area = e_012 + e_013 + e_023 + e_123
                ga += p_a + q_a - s_b - s_c
                gb += p_b + r_b + s_b
                gc += q_c + r_c + s_c
            up = vec3()
            if wp.static(gravity_on):
                weight = gravity_weight[k] * v0
                e_gravity = gravity_term(u0, u1, u2, u3, weight)
                up = vec3(zero, zero, weight)
            add_gradient(gradient, slab, n, ga, gb, gc, up)
            if not (growth > scalar(-1.0)):
                is_inverted = wp.int32(1)
                if inverted_before[t] == wp.int8(0):
                    is_new = wp.int32(1)
            inverted[t] = wp.int8(is_inverted)
        add(sums, slab, DISTANCE, wp.float64(e_distance))
        if wp.static(epsilon_term):
            add(sums, slab, AREA, wp.float64(e_area))
        if wp.static(theta_term):
            add(sums, slab, VOLUME, wp.float64(e_volume))
        if wp.static(gravity_on):
            add(sums, slab, GRAVITY, wp.float64(e_gravity))
        add(sums, slab, INVERTED, wp.float64(is_inverted))
        add(sums, slab, NEWLY_INVERTED, wp.float64(is_new))

    def make_curvature(positive: bool) -> wp.Kernel:
        clip = wp.constant(positive)

        @wp.kernel(module="unique", enable_backward=False)
        def curvature_kernel(
            first: int,
            end: int,
            slab: int,
            tets: wp.array(dtype=wp.vec4i),
            rest_edge: wp.array(dtype=vec3, ndim=2),
            rest_length: wp.array(dtype=vec6),
            rest_area: wp.array(dtype=vec4),
            rest_volume: wp.array(dtype=scalar),
            edge_weight: wp.array(dtype=vec6),
            face_weight: wp.array(dtype=vec4),
            theta: wp.array(dtype=scalar),
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
                a0 = rest_edge[t, 0]
                b0 = rest_edge[t, 1]
                c0 = rest_edge[t, 2]
                u0 = displacement[n[0]]
                da = displacement[n[1]] - u0
                db = displacement[n[2]] - u0
                dc = displacement[n[3]] - u0
                length = rest_length[t]
                w = edge_weight[t]
                k01 = distance_curvature(a0, da, length[0], w[0], clip)
                k02 = distance_curvature(b0, db, length[1], w[1], clip)
                k03 = distance_curvature(c0, dc, length[2], w[2], clip)
                k12 = distance_curvature(b0 - a0, db - da, length[3], w[3], clip)
                k13 = distance_curvature(c0 - a0, dc - da, length[4], w[4], clip)
                k23 = distance_curvature(c0 - b0, dc - db, length[5], w[5], clip)
                aa = k01 + k12 + k13
                bb = k02 + k12 + k23
                cc = k03 + k13 + k23
                ab = -k12
                ac = -k13
                bc = -k23
                if wp.static(theta_term):
                    ga, gb, gc = volume_gradients(a0 + da, b0 + db, c0 + dc)
                    v0 = rest_volume[t]
                    stiffness = (theta[k] + theta[k]) / (v0 * v0)
                    aa += stiffness * wp.outer(ga, ga)
                    bb += stiffness * wp.outer(gb, gb)
                    cc += stiffness * wp.outer(gc, gc)
                    ab += stiffness * wp.outer(ga, gb)
                    ac += stiffness * wp.outer(ga, gc)
                    bc += stiffness * wp.outer(gb, gc)
                    if not wp.static(positive):
                        growth = relative_volume_change(a0, b0, c0, da, db, dc, v0)
                        turn = stiffness * growth * v0 / scalar(6.0)
                        ab -= turn * wp.skew(c0 + dc)
                        ac += turn * wp.skew(b0 + db)
                        bc -= turn * wp.skew(a0 + da)
                if wp.static(epsilon_term):
                    s = rest_area[t]
                    v = face_weight[t]
                    p_aa, p_ab, p_bb = area_curvature(a0, b0, da, db, s[3], v[3], clip)
                    q_aa, q_ac, q_cc = area_curvature(a0, c0, da, dc, s[2], v[2], clip)
                    r_bb, r_bc, r_cc = area_curvature(b0, c0, db, dc, s[1], v[1], clip)
                    s_bb, s_bc, s_cc = area_curvature(b0 - a0, c0 - a0, db - da, dc - da, s[0], v[0], clip)
                    s_cb = wp.transpose(s_bc)
                    aa += p_aa + q_aa + s_bb + s_bc + s_cb + s_cc
                    bb += p_bb + r_bb + s_bb
                    cc += q_cc + r_cc + s_cc
                    ab += p_ab - s_bb - s_cb
                    ac += q_ac - s_bc - s_cc
                    bc += r_bc + s_bc
                add_curvature(blocks, slab, t, block_of, aa, ab, ac, bb, bc, cc)

        return curvature_kernel

    return SimpleNamespace(
        gradient=gradient_kernel,
        curvature=make_curvature(positive=True),
        true_curvature=make_curvature(positive=False),
    )
