"""Distance from points to a triangle mesh, with a sign by winding number or without."""

from __future__ import annotations

import warp as wp


@wp.kernel(enable_backward=False)
def signed_distance(
    first: wp.int32,
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    reach: wp.float32,
    distance: wp.array(dtype=wp.float32),
    face: wp.array(dtype=wp.int32),
    nearest: wp.array(dtype=wp.vec3),
):
    """Distance [mm], negative inside, the nearest triangle and point; NaN and -1 farther away than `reach`.

    The winding number gives the right sign inside overlapping and self-intersecting parts too.
    """
    i = first + wp.tid()
    query = wp.mesh_query_point_sign_winding_number(mesh, points[i], reach)
    if query.result:
        nearest[i] = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
        distance[i] = query.sign * wp.length(points[i] - nearest[i])
        face[i] = query.face
    else:
        distance[i] = wp.nan
        face[i] = -1
        nearest[i] = wp.vec3(wp.nan)


@wp.kernel(enable_backward=False)
def plain_distance(
    first: wp.int32,
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    reach: wp.float32,
    distance: wp.array(dtype=wp.float32),
):
    """Distance [mm] without a sign, which takes most of the time; NaN farther away than `reach`."""
    i = first + wp.tid()
    query = wp.mesh_query_point_no_sign(mesh, points[i], reach)
    distance[i] = wp.nan
    if query.result:
        distance[i] = wp.length(points[i] - wp.mesh_eval_position(mesh, query.face, query.u, query.v))
