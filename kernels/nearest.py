"""The nearest point of a triangle mesh to each of many points."""

from __future__ import annotations

import warp as wp


@wp.kernel(enable_backward=False)
def nearest_on_mesh(
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    reach: wp.float32,
    face: wp.array(dtype=wp.int32),
    weights: wp.array(dtype=wp.vec3),
):
    """The nearest triangle and the weights of its three corners; face -1 where none is within `reach`."""
    i = wp.tid()
    query = wp.mesh_query_point_no_sign(mesh, points[i], reach)
    if query.result:
        face[i] = query.face
        weights[i] = wp.vec3(query.u, query.v, 1.0 - query.u - query.v)
    else:
        face[i] = -1
        weights[i] = wp.vec3(0.0)
