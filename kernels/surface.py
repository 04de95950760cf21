"""Queries on triangle surfaces: distance, nearest point, crossings and edge collapses."""

from __future__ import annotations

import warp as wp

from .arguments import Doubles, Ints, Points


@wp.kernel(enable_backward=False)
def signed_distance(
    first: int,
    mesh: wp.uint64,
    points: wp.array[wp.vec3],
    reach: float,
    distance: wp.array[wp.float32],
    face: Ints,
    nearest: wp.array[wp.vec3],
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
def nearest_on_mesh(
    mesh: wp.uint64, points: wp.array[wp.vec3], reach: float, face: Ints, weights: wp.array[wp.vec3]
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


@wp.func
def pierces(p: wp.vec3d, q: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, slack: wp.float64) -> wp.bool:
    """Whether the segment p q meets the triangle a b c; slack is relative, and lets near misses count.

    A segment in the plane of the triangle meets none: then one of its neighbours does.
    """
    unity = wp.float64(1.0)
    ab = b - a
    ac = c - a
    pq = q - p
    normal = wp.cross(ab, ac)
    slope = wp.dot(normal, pq)
    if wp.abs(slope) <= wp.float64(1.0e-12) * wp.length(normal) * wp.length(pq):
        return False
    t = wp.dot(normal, a - p) / slope
    if t < -slack or t > unity + slack:
        return False
    hit = p + t * pq - a
    square = wp.dot(normal, normal)
    u = wp.dot(wp.cross(hit, ac), normal) / square
    v = wp.dot(wp.cross(ab, hit), normal) / square
    return u >= -slack and v >= -slack and u + v <= unity + slack


@wp.func
def has_corner(faces: Ints, g: int, v: int) -> wp.bool:
    """Whether a vertex is a corner of face g."""
    return faces[3 * g] == v or faces[3 * g + 1] == v or faces[3 * g + 2] == v


@wp.func
def meets(vertices: Points, faces: Ints, f: int, g: int, slack: wp.float64) -> wp.bool:
    """Whether an edge of face f that shares no corner with face g passes through g."""
    a = vertices[faces[3 * g]]
    b = vertices[faces[3 * g + 1]]
    c = vertices[faces[3 * g + 2]]
    hit = False
    for k in range(3):
        i = faces[3 * f + k]
        j = faces[3 * f + (k + 1) % 3]
        if not has_corner(faces, g, i) and not has_corner(faces, g, j):
            hit = hit or pierces(vertices[i], vertices[j], a, b, c, slack)
    return hit


@wp.func
def box_of(vertices: Points, faces: Ints, f: int):
    """Lower and upper corner of the box of a face, a little larger than it."""
    a = vertices[faces[3 * f]]
    b = vertices[faces[3 * f + 1]]
    c = vertices[faces[3 * f + 2]]
    lower = wp.vec3(wp.min(wp.min(a, b), c)) - wp.vec3(1.0e-3)
    upper = wp.vec3(wp.max(wp.max(a, b), c)) + wp.vec3(1.0e-3)
    return lower, upper


@wp.kernel(enable_backward=False)
def crossing_faces(first: int, mesh: wp.uint64, vertices: Points, faces: Ints, slack: wp.float64, crossed: Ints):
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


LEAST_TURN = wp.constant(wp.float64(0.4))
"""No collapse turns a triangle further than the angle with this cosine, 66 degrees."""
LEAST_SHAPE = wp.constant(wp.float64(0.3))
"""No collapse makes a triangle with a lower shape than this; 1 is equilateral, 0 is flat."""


@wp.kernel(enable_backward=False)
def sort_corners(faces: wp.array2d[wp.int32], place: Ints, second: Ints, face: Ints):
    """Puts the directed edges of faces in order of their first vertices; one item, `place` begins as `start`."""
    for f in range(faces.shape[0]):
        for c in range(3):
            v = faces[f, c]
            at = place[v]
            place[v] = at + 1
            second[at] = faces[f, (c + 1) % 3]
            face[at] = f


@wp.kernel(enable_backward=False)
def edge_lengths(start: Ints, second: Ints, vertices: Points, length: Doubles):
    """Length of every edge, at that of its directions which leads to the higher number; infinite at the other."""
    v = wp.tid()
    for k in range(start[v], start[v + 1]):
        length[k] = wp.float64(wp.inf)
        if v < second[k]:
            length[k] = wp.length(vertices[v] - vertices[second[k]])


@wp.kernel(enable_backward=False)
def least_around(start: Ints, second: Ints, value: Doubles, asked: wp.array[wp.bool], least: Doubles):
    """The least value at a vertex and its neighbours, where it is asked for."""
    v = wp.tid()
    if not asked[v]:
        return
    smallest = value[v]
    for k in range(start[v], start[v + 1]):
        smallest = wp.min(smallest, value[second[k]])
    least[v] = smallest


@wp.func
def shape(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> wp.float64:
    """1 for an equilateral triangle, 0 for a flat one."""
    squares = wp.length_sq(b - a) + wp.length_sq(c - b) + wp.length_sq(a - c)
    return wp.float64(2.0) * wp.sqrt(wp.float64(3.0)) * wp.length(wp.cross(b - a, c - b)) / squares


@wp.func
def fits(before: wp.vec3d, i: wp.vec3d, j: wp.vec3d, k: wp.vec3d, longest: wp.float64) -> wp.bool:
    """Whether a triangle with a normal before may become i j k: it does not turn over, and no edge is too long."""
    after = wp.cross(j - i, k - j)
    side = wp.max(wp.max(wp.length_sq(j - i), wp.length_sq(k - j)), wp.length_sq(i - k))
    flat = LEAST_TURN * wp.length(after) * wp.length(before)
    return wp.dot(before, after) > flat and side < longest * longest


@wp.kernel(enable_backward=False)
def allowed_collapses(
    edges: wp.array[wp.vec2i],
    targets: Points,
    start: Ints,
    second: Ints,
    face: Ints,
    faces: wp.array2d[wp.int32],
    vertices: Points,
    longest: wp.float64,
    sliver: wp.float64,
    allowed: wp.array[wp.bool],
):
    """Whether an edge may become its target: the surface stays a 2-manifold and its triangles stay in shape.

    Triangles of a lower shape than `sliver` have no normal of their own: they may stay so, or become others that
    face as all triangles around the edge do.

    The link condition: the ends have exactly the two vertices opposite the edge as common neighbours.
    """
    e = wp.tid()
    p = edges[e][0]
    q = edges[e][1]
    target = targets[e]
    common = wp.int32(0)
    for m in range(start[p], start[p + 1]):
        for n in range(start[q], start[q + 1]):
            if second[m] == second[n]:
                common += 1
    few = wp.min(start[p + 1] - start[p], start[q + 1] - start[q])
    many = wp.max(start[p + 1] - start[p], start[q + 1] - start[q])
    good = common == 2 and (few > 3 or (sliver > wp.float64(0.0) and many > 3))
    worst = wp.float64(LEAST_SHAPE)
    least = wp.float64(wp.inf)
    around = wp.vec3d()
    for end in range(2):
        v = edges[e][end]
        for s in range(start[v], start[v + 1]):
            f = face[s]
            a = vertices[faces[f, 0]]
            around += wp.cross(vertices[faces[f, 1]] - a, vertices[faces[f, 2]] - a)
    for end in range(2):
        v = edges[e][end]
        for s in range(start[v], start[v + 1]):
            f = face[s]
            a = vertices[faces[f, 0]]
            b = vertices[faces[f, 1]]
            c = vertices[faces[f, 2]]
            was = shape(a, b, c)
            if was >= sliver:
                worst = wp.min(worst, was)
            i_moves = faces[f, 0] == p or faces[f, 0] == q
            j_moves = faces[f, 1] == p or faces[f, 1] == q
            k_moves = faces[f, 2] == p or faces[f, 2] == q
            i = wp.where(i_moves, target, a)
            j = wp.where(j_moves, target, b)
            k = wp.where(k_moves, target, c)
            if int(i_moves) + int(j_moves) + int(k_moves) == 1:  # the two triangles on both ends vanish
                new = shape(i, j, k)
                if was >= sliver:
                    least = wp.min(least, new)
                    good = good and fits(wp.cross(b - a, c - a), i, j, k, longest)
                elif new >= sliver:
                    good = good and fits(around, i, j, k, longest)
    allowed[e] = good and least > worst
