"""What parallel rays see of a surface."""

from __future__ import annotations

import warp as wp


@wp.kernel(enable_backward=False)
def first_hit(
    mesh: wp.uint64,
    corner: wp.vec3,
    right: wp.vec3,
    down: wp.vec3,
    forward: wp.vec3,
    reach: wp.float32,
    face: wp.array2d(dtype=wp.int32),
    weights: wp.array2d(dtype=wp.vec3),
):
    """For each pixel the face that its ray meets first, -1 for none, and the weights of the face's corners there.

    The ray of the pixel in row i and column j starts at corner + i down + j right and goes `reach` along the
    unit vector `forward`.
    """
    i, j = wp.tid()
    start = corner + wp.float32(i) * down + wp.float32(j) * right
    hit = wp.mesh_query_ray(mesh, start, forward, reach)
    face[i, j] = -1
    if hit.result:
        face[i, j] = hit.face
        weights[i, j] = wp.vec3(hit.u, hit.v, 1.0 - hit.u - hit.v)
