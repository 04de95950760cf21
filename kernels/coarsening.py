"""Around the edges of a closed triangle surface: who is next to whom, and which edges may be collapsed.

The directed edges from vertex v are items start[v] to start[v + 1] of `second` (where they lead) and `face` (on
their left), so that over them each neighbour and each face of v comes once.
"""

from __future__ import annotations

import warp as wp

LEAST_TURN = wp.constant(wp.float64(0.4))
"""No collapse turns a triangle further than the angle with this cosine, 66 degrees."""
LEAST_SHAPE = wp.constant(wp.float64(0.3))
"""No collapse makes a triangle with a lower shape than this; 1 is equilateral, 0 is flat."""


@wp.kernel(enable_backward=False)
def sort_corners(
    faces: wp.array(dtype=wp.int32, ndim=2),
    place: wp.array(dtype=wp.int32),
    second: wp.array(dtype=wp.int32),
    face: wp.array(dtype=wp.int32),
):
    """Puts the directed edges of faces in order of their first vertices; one item, `place` begins as `start`."""
    for f in range(faces.shape[0]):
        for c in range(3):
            v = faces[f, c]
            at = place[v]
            place[v] = at + 1
            second[at] = faces[f, (c + 1) % 3]
            face[at] = f


@wp.kernel(enable_backward=False)
def edge_lengths(
    start: wp.array(dtype=wp.int32),
    second: wp.array(dtype=wp.int32),
    vertices: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
):
    """Length of every edge, at that of its directions which leads to the higher number; infinite at the other."""
    v = wp.tid()
    for k in range(start[v], start[v + 1]):
        length[k] = wp.float64(wp.inf)
        if v < second[k]:
            length[k] = wp.length(vertices[v] - vertices[second[k]])


@wp.kernel(enable_backward=False)
def least_around(
    start: wp.array(dtype=wp.int32),
    second: wp.array(dtype=wp.int32),
    value: wp.array(dtype=wp.float64),
    asked: wp.array(dtype=wp.bool),
    least: wp.array(dtype=wp.float64),
):
    """The least value at a vertex and its neighbours, where it is asked for."""
    v = wp.tid()
    if not asked[v]:
        return
    found = value[v]
    for k in range(start[v], start[v + 1]):
        found = wp.min(found, value[second[k]])
    least[v] = found


@wp.func
def shape(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> wp.float64:
    """1 for an equilateral triangle, 0 for a flat one."""
    squares = wp.length_sq(b - a) + wp.length_sq(c - b) + wp.length_sq(a - c)
    return wp.float64(2.0) * wp.sqrt(wp.float64(3.0)) * wp.length(wp.cross(b - a, c - b)) / squares


@wp.func
def fits(
    a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, i: wp.vec3d, j: wp.vec3d, k: wp.vec3d, longest: wp.float64
) -> wp.bool:
    """Whether the triangle a b c may become i j k: it does not turn over, and no edge is too long."""
    before = wp.cross(b - a, c - a)
    after = wp.cross(j - i, k - j)
    side = wp.max(wp.max(wp.length_sq(j - i), wp.length_sq(k - j)), wp.length_sq(i - k))
    flat = LEAST_TURN * wp.length(after) * wp.length(before)
    return wp.dot(before, after) > flat and side < longest * longest


@wp.kernel(enable_backward=False)
def allowed_collapses(
    edges: wp.array(dtype=wp.vec2i),
    targets: wp.array(dtype=wp.vec3d),
    start: wp.array(dtype=wp.int32),
    second: wp.array(dtype=wp.int32),
    face: wp.array(dtype=wp.int32),
    faces: wp.array(dtype=wp.int32, ndim=2),
    vertices: wp.array(dtype=wp.vec3d),
    longest: wp.float64,
    allowed: wp.array(dtype=wp.bool),
):
    """Whether an edge may become its target: the surface stays a 2-manifold and its triangles stay in shape.

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
    good = common == 2 and start[p + 1] - start[p] > 3 and start[q + 1] - start[q] > 3
    worst = wp.float64(LEAST_SHAPE)
    least = wp.float64(wp.inf)
    for end in range(2):
        v = edges[e][end]
        for s in range(start[v], start[v + 1]):
            f = face[s]
            a = vertices[faces[f, 0]]
            b = vertices[faces[f, 1]]
            c = vertices[faces[f, 2]]
            worst = wp.min(worst, shape(a, b, c))
            i = a
            j = b
            k = c
            moved = wp.int32(0)
            if faces[f, 0] == p or faces[f, 0] == q:
                i = target
                moved += 1
            if faces[f, 1] == p or faces[f, 1] == q:
                j = target
                moved += 1
            if faces[f, 2] == p or faces[f, 2] == q:
                k = target
                moved += 1
            if moved == 1:  # the two triangles on both ends vanish
                least = wp.min(least, shape(i, j, k))
                good = good and fits(a, b, c, i, j, k, longest)
    allowed[e] = good and least > worst
