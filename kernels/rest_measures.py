"""Measures of tetrahedra at rest, in float64 whatever they are kept in: rounded once, as NumPy would."""

from functools import cache
from types import SimpleNamespace

import warp as wp

NOT_FUSED = {"fuse_fp": False}
"""Every operation is rounded by itself, so that all devices find the same bits."""


@wp.func
def length(v: wp.vec3d) -> wp.float64:
    return wp.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@wp.func
def volume(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> wp.float64:
    """Of a tetrahedron by its edge vectors; added up in the order of `tet_volumes`."""
    normal = wp.cross(b, c)
    return (a[0] * normal[0] + a[2] * normal[2] + a[1] * normal[1]) / wp.float64(6.0)


@cache
def rest_kernels(scalar: type) -> SimpleNamespace:
    """`itmsm` and `neo_hookean`: what the arrays of the energies of these names hold."""
    vec3 = wp.types.vector(3, scalar)
    vec4 = wp.types.vector(4, scalar)
    vec6 = wp.types.vector(6, scalar)

    @wp.kernel(module="unique", module_options=NOT_FUSED, enable_backward=False)
    def itmsm_kernel(
        first: int,
        end: int,
        slab: int,
        tets: wp.array(dtype=wp.vec4i),
        nodes: wp.array(dtype=wp.vec3d),
        rest_edge: wp.array(dtype=vec3, ndim=2),
        rest_length: wp.array(dtype=vec6),
        rest_area: wp.array(dtype=vec4),
        rest_volume: wp.array(dtype=scalar),
    ):
        """Edge vectors from corner 0, lengths, areas (none where there is no room for them) and volumes."""
        t = first + wp.tid()
        if t < end:
            corner = tets[t]
            o = nodes[corner[0]]
            p = nodes[corner[1]]
            q = nodes[corner[2]]
            r = nodes[corner[3]]
            a = p - o
            b = q - o
            c = r - o
            rest_edge[t, 0] = vec3(a)
            rest_edge[t, 1] = vec3(b)
            rest_edge[t, 2] = vec3(c)
            rest_length[t] = vec6(
                scalar(length(a)),
                scalar(length(b)),
                scalar(length(c)),
                scalar(length(q - p)),
                scalar(length(r - p)),
                scalar(length(r - q)),
            )
            rest_volume[t] = scalar(volume(a, b, c))
            if rest_area.shape[0] > 0:
                half = wp.float64(0.5)
                rest_area[t] = vec4(
                    scalar(half * length(wp.cross(q - p, r - p))),
                    scalar(half * length(wp.cross(b, c))),
                    scalar(half * length(wp.cross(a, c))),
                    scalar(half * length(wp.cross(a, b))),
                )

    @wp.kernel(module="unique", module_options=NOT_FUSED, enable_backward=False)
    def neo_hookean_kernel(
        first: int,
        end: int,
        slab: int,
        tets: wp.array(dtype=wp.vec4i),
        nodes: wp.array(dtype=wp.vec3d),
        shape_gradient: wp.array(dtype=vec3, ndim=2),
        rest_volume: wp.array(dtype=scalar),
    ):
        """Gradients of the shape functions of corners 1, 2 and 3, and volumes."""
        t = first + wp.tid()
        if t < end:
            corner = tets[t]
            o = nodes[corner[0]]
            a = nodes[corner[1]] - o
            b = nodes[corner[2]] - o
            c = nodes[corner[3]] - o
            whole = volume(a, b, c)
            rest_volume[t] = scalar(whole)
            six = wp.float64(6.0) * whole
            for k in range(3):
                area = wp.where(k == 0, wp.cross(b, c), wp.where(k == 1, wp.cross(c, a), wp.cross(a, b)))
                shape_gradient[t, k] = vec3(scalar(area[0] / six), scalar(area[1] / six), scalar(area[2] / six))

    return SimpleNamespace(itmsm=itmsm_kernel, neo_hookean=neo_hookean_kernel)
