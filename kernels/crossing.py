"""Where triangles of a surface pass through each other."""

from __future__ import annotations

import warp as wp


@wp.func
def pierces(p: wp.vec3d, q: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, slack: wp.float64) -> wp.bool:
    """Whether the segment p q meets the triangle a b c; slack is relative, and lets near misses count.

    A segment in the plane of the triangle meets none: then one of its neighbours does.
    """
    one = wp.float64(1.0)
    ab = b - a
    ac = c - a
    pq = q - p
    normal = wp.cross(ab, ac)
    slope = wp.dot(normal, pq)
    if wp.abs(slope) <= wp.float64(1.0e-12) * wp.length(normal) * wp.length(pq):
        return False
    t = wp.dot(normal, a - p) / slope
    if t < -slack or t > one + slack:
        return False
    hit = p + t * pq - a
    square = wp.dot(normal, normal)
    u = wp.dot(wp.cross(hit, ac), normal) / square
    v = wp.dot(wp.cross(ab, hit), normal) / square
    return u >= -slack and v >= -slack and u + v <= one + slack


@wp.func
def one_of(i: wp.int32, p: wp.int32, q: wp.int32, r: wp.int32) -> wp.bool:
    first = i == p
    second = i == q
    third = i == r
    return first or second or third


@wp.func
def meets(
    vertices: wp.array(dtype=wp.vec3d),
    faces: wp.array(dtype=wp.int32),
    f: wp.int32,
    g: wp.int32,
    slack: wp.float64,
) -> wp.bool:
    """Whether an edge of face f that shares no corner with face g passes through g."""
    i = faces[3 * f]
    j = faces[3 * f + 1]
    k = faces[3 * f + 2]
    p = faces[3 * g]
    q = faces[3 * g + 1]
    r = faces[3 * g + 2]
    has_i = one_of(i, p, q, r)
    has_j = one_of(j, p, q, r)
    has_k = one_of(k, p, q, r)
    a = vertices[i]
    b = vertices[j]
    c = vertices[k]
    d = vertices[p]
    e = vertices[q]
    h = vertices[r]
    hit = False
    if not has_i and not has_j:
        hit = hit or pierces(a, b, d, e, h, slack)
    if not has_j and not has_k:
        hit = hit or pierces(b, c, d, e, h, slack)
    if not has_k and not has_i:
        hit = hit or pierces(c, a, d, e, h, slack)
    return hit


@wp.func
def box_of(vertices: wp.array(dtype=wp.vec3d), faces: wp.array(dtype=wp.int32), f: wp.int32):
    """Lower and upper corner of the box of a face, a little larger than it."""
    a = vertices[faces[3 * f]]
    b = vertices[faces[3 * f + 1]]
    c = vertices[faces[3 * f + 2]]
    lower = wp.vec3(wp.min(wp.min(a, b), c)) - wp.vec3(1.0e-3)
    upper = wp.vec3(wp.max(wp.max(a, b), c)) + wp.vec3(1.0e-3)
    return lower, upper


@wp.kernel(enable_backward=False)
def crossing_faces(
    first: wp.int32,
    mesh: wp.uint64,
    vertices: wp.array(dtype=wp.vec3d),
    faces: wp.array(dtype=wp.int32),
    slack: wp.float64,
    crossed: wp.array(dtype=wp.int32),
):
    """For each face, a face that one of its edges passes through and has no corner of, or -1.

    Two triangles that cross without a common corner have an edge of one in the other; two with one common
    corner have the opposite edge of one in the other. So testing edges against faces apart finds both.
    """
    f = first + wp.tid()
    crossed[f] = -1
    lower, upper = box_of(vertices, faces, f)
    query = wp.mesh_query_aabb(mesh, lower, upper)
    g = wp.int32(0)
    while wp.mesh_query_aabb_next(query, g):
        if meets(vertices, faces, f, g, slack):
            crossed[f] = g


@wp.kernel(enable_backward=False)
def crossed_by_any(
    first: wp.int32,
    mesh: wp.uint64,
    vertices: wp.array(dtype=wp.vec3d),
    faces: wp.array(dtype=wp.int32),
    asked: wp.array(dtype=wp.int32),
    slack: wp.float64,
    crossed: wp.array(dtype=wp.bool),
):
    """For each face asked for, whether it and another pass through each other."""
    n = first + wp.tid()
    f = asked[n]
    hit = wp.bool(False)
    lower, upper = box_of(vertices, faces, f)
    query = wp.mesh_query_aabb(mesh, lower, upper)
    g = wp.int32(0)
    while wp.mesh_query_aabb_next(query, g):
        hit = hit or meets(vertices, faces, f, g, slack) or meets(vertices, faces, g, f, slack)
    crossed[n] = hit
