"""Tetrahedra at rest: their measures, which nodes are neighbours, and moving nodes to improve their shape."""

from functools import cache
from types import SimpleNamespace

import warp as wp


@wp.kernel(enable_backward=False)
def count_around(tets: wp.array(dtype=wp.vec4i), count: wp.array(dtype=wp.int32)):
    """Counts the tetrahedra around each node."""
    t = wp.tid()
    for a in range(4):
        wp.atomic_add(count, tets[t][a], 1)


@wp.kernel(enable_backward=False)
def list_around(tets: wp.array(dtype=wp.vec4i), place: wp.array(dtype=wp.int32), around: wp.array(dtype=wp.int32)):
    """Lists for each node the corners, 4 t + a, that it is; `place` is where its list goes on."""
    t = wp.tid()
    for a in range(4):
        around[wp.atomic_add(place, tets[t][a], 1)] = 4 * t + a


@wp.func
def others_of_face(tet: wp.vec4i, face: int, corner: int):
    """The lower and the higher of the two other nodes of a face, which lies opposite a corner."""
    low = wp.int32(-1)
    high = wp.int32(-1)
    for b in range(4):
        if b != face and b != corner:
            low = wp.where(high < 0, tet[b], wp.min(high, tet[b]))
            high = wp.max(high, tet[b])
    return low, high


@wp.func
def edge_between(a: int, b: int) -> int:
    """The edge of two corners: 01 02 03 12 13 23."""
    return wp.where(wp.min(a, b) == 0, a + b - 1, a + b)


@wp.func
def counted(
    low: wp.array(dtype=wp.int32),
    high: wp.array(dtype=wp.int32),
    count: wp.array(dtype=wp.int32),
    begin: int,
    stop: int,
    one: int,
    other: int,
) -> int:
    """Where two numbers stand together in a list, counted there; where they do not, they are put at its end."""
    k = int(begin)
    while k < stop and (low[k] != one or high[k] != other):
        k += 1
    if k == stop:
        low[k] = one
        high[k] = other
        count[k] = 0
    count[k] += 1
    return k


@wp.kernel(enable_backward=False)
def count_shared(
    first: int,
    end: int,
    slab: int,
    tets: wp.array(dtype=wp.vec4i),
    start: wp.array(dtype=wp.int32),
    around: wp.array(dtype=wp.int32),
    low: wp.array(dtype=wp.int32),
    high: wp.array(dtype=wp.int32),
    count: wp.array(dtype=wp.int32),
    edge: wp.array(dtype=wp.uint16, ndim=2),
    face: wp.array(dtype=wp.uint16, ndim=2),
):
    """How many tetrahedra have each edge and each face whose lowest node is this one.

    `low`, `high` and `count` are room for three edges or faces of every corner. What is found of a tetrahedron is
    first where its edge or face stands in the list.
    """
    i = first + wp.tid()
    if i < end:
        begin = 3 * start[i]
        for faces in range(2):
            stop = int(begin)
            for e in range(start[i], start[i + 1]):
                t = around[e] // 4
                a = around[e] % 4
                tet = tets[t]
                for b in range(4):
                    if b != a:
                        if faces == 1:
                            one, other = others_of_face(tet, b, a)
                            if one > i:
                                k = counted(low, high, count, begin, stop, one, other)
                                stop = wp.max(stop, k + 1)
                                face[t, b] = wp.uint16(k - begin)
                        elif tet[b] > i:
                            k = counted(low, high, count, begin, stop, tet[b], 0)
                            stop = wp.max(stop, k + 1)
                            edge[t, edge_between(a, b)] = wp.uint16(k - begin)
            for e in range(start[i], start[i + 1]):
                t = around[e] // 4
                a = around[e] % 4
                tet = tets[t]
                for b in range(4):
                    if b != a:
                        if faces == 1:
                            one, other = others_of_face(tet, b, a)
                            if one > i:
                                face[t, b] = wp.uint16(count[begin + wp.int32(face[t, b])])
                        elif tet[b] > i:
                            k = edge_between(a, b)
                            edge[t, k] = wp.uint16(count[begin + wp.int32(edge[t, k])])


@wp.kernel(enable_backward=False)
def list_neighbours(
    first: int,
    end: int,
    slab: int,
    size: int,
    tets: wp.array(dtype=wp.vec4i),
    start: wp.array(dtype=wp.int32),
    around: wp.array(dtype=wp.int32),
    neighbours: wp.array(dtype=wp.int32),
    count: wp.array(dtype=wp.int32),
):
    """The nodes below `size` that share a tetrahedron with each, ascending, it among them.

    `neighbours` is room for three nodes of every corner and for each node itself.
    """
    i = first + wp.tid()
    if i < end:
        begin = 3 * start[i] + i
        stop = begin + 1
        neighbours[begin] = i
        for e in range(start[i], start[i + 1]):
            tet = tets[around[e] // 4]
            for b in range(4):
                n = tet[b]
                if n < size:
                    k = int(stop)
                    while k > begin and neighbours[k - 1] > n:
                        k -= 1
                    if k == begin or neighbours[k - 1] != n:
                        for m in range(stop - k):
                            neighbours[stop - m] = neighbours[stop - m - 1]
                        neighbours[k] = n
                        stop += 1
        count[i] = stop - begin


@wp.kernel(enable_backward=False)
def write_rows(
    first: int,
    end: int,
    slab: int,
    size: int,
    tets: wp.array(dtype=wp.vec4i),
    start: wp.array(dtype=wp.int32),
    around: wp.array(dtype=wp.int32),
    neighbours: wp.array(dtype=wp.int32),
    row_start: wp.array(dtype=wp.int32),
    columns: wp.array(dtype=wp.int32),
    place: wp.array(dtype=wp.uint16, ndim=2),
):
    """The lists of neighbours one after the other, and the place of each pair of corners in its row, from 1."""
    i = first + wp.tid()
    if i < end:
        begin = 3 * start[i] + i
        row = row_start[i]
        for k in range(row_start[i + 1] - row):
            columns[row + k] = neighbours[begin + k]
        for e in range(start[i], start[i + 1]):
            t = around[e] // 4
            a = around[e] % 4
            for b in range(4):
                n = tets[t][b]
                if n < size:
                    low = wp.int32(0)
                    left = row_start[i + 1] - row
                    while left > 0:  # without branches, which nothing could predict
                        half = left // 2
                        above = neighbours[begin + low + half] < n
                        low = wp.where(above, low + half + 1, low)
                        left = wp.where(above, left - half - 1, half)
                    place[t, 4 * a + b] = wp.uint16(low + 1)


@wp.kernel(enable_backward=False)
def take_lowest(
    tets: wp.array(dtype=wp.vec4i), label: wp.array(dtype=wp.int32), changes: wp.array(dtype=wp.int32)
):
    """Gives all corners of a tetrahedron the lowest of their labels, which are nodes of their piece."""
    t = wp.tid()
    lowest = label[tets[t][0]]
    for a in range(1, 4):
        lowest = wp.min(lowest, label[tets[t][a]])
    lowest = label[lowest]
    for a in range(4):
        if wp.atomic_min(label, tets[t][a], lowest) > lowest:
            changes[0] = 1


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


LEAST_GAIN = wp.constant(wp.float64(1.0e-3))
"""A node is moved where the worst tetrahedron at it gets better by more than this."""


@wp.func
def mean_ratio(i: wp.vec3d, j: wp.vec3d, k: wp.vec3d, m: wp.vec3d) -> wp.float64:
    """12 (3 V)^(2/3) / sum of squared edges: 1 for a regular tetrahedron, 0 flat, negative inverted."""
    a = j - i
    b = k - i
    c = m - i
    six = wp.dot(a, wp.cross(b, c))
    edges = wp.length_sq(a) + wp.length_sq(b) + wp.length_sq(c)
    edges += wp.length_sq(k - j) + wp.length_sq(m - j) + wp.length_sq(m - k)
    root = wp.cbrt(wp.float64(0.5) * six)
    return wp.float64(12.0) * root * root * wp.sign(six) / edges


@wp.kernel(enable_backward=False)
def mean_ratios(corners: wp.array(dtype=wp.vec3d, ndim=2), quality: wp.array(dtype=wp.float64)):
    """Quality of tetrahedra by their corners."""
    t = wp.tid()
    quality[t] = mean_ratio(corners[t, 0], corners[t, 1], corners[t, 2], corners[t, 3])


@wp.func
def quality_with(
    tets: wp.array(dtype=wp.vec4i), nodes: wp.array(dtype=wp.vec3d), tet: wp.int32, node: wp.int32, place: wp.vec3d
) -> wp.float64:
    """Quality of a tetrahedron with one of its nodes at another place."""
    n = tets[tet]
    i = nodes[n[0]]
    j = nodes[n[1]]
    k = nodes[n[2]]
    m = nodes[n[3]]
    if n[0] == node:
        i = place
    if n[1] == node:
        j = place
    if n[2] == node:
        k = place
    if n[3] == node:
        m = place
    return mean_ratio(i, j, k, m)


@wp.kernel(enable_backward=False)
def move_nodes(
    turns: wp.array(dtype=wp.int32),
    goal: wp.float64,
    tets: wp.array(dtype=wp.vec4i),
    start: wp.array(dtype=wp.int32),
    star: wp.array(dtype=wp.int32),
    around: wp.array(dtype=wp.vec3d),
    reach: wp.array(dtype=wp.float64),
    given: wp.array(dtype=wp.vec3d),
    moved: wp.array(dtype=wp.vec3d),
    quality: wp.array(dtype=wp.float64),
    moves: wp.array(dtype=wp.int32),
):
    """Gives the nodes in `turns` their turns; one item, because each sees where those before it went.

    `star` holds the tetrahedra of every node from `start` on. A node goes to the best place of `around`, in mean
    edge lengths, within its reach of where it was given.
    """
    for turn in range(turns.shape[0]):
        node = turns[turn]
        first = start[node]
        end = start[node + 1]
        worst = wp.float64(wp.inf)
        for s in range(first, end):
            worst = wp.min(worst, quality[star[s]])
        if reach[node] > wp.float64(0.0) and worst < goal:
            here = moved[node]
            size = wp.float64(0.0)
            for s in range(first, end):
                n = tets[star[s]]
                for c in range(4):
                    size += wp.length(moved[n[c]] - here)
            size = size / wp.float64(3 * (end - first))
            best = worst + LEAST_GAIN
            best_place = here
            for k in range(around.shape[0]):
                place = here + size * around[k]
                if wp.length(place - given[node]) <= reach[node]:
                    least = wp.float64(wp.inf)
                    s = first
                    while s < end and least > best:
                        least = wp.min(least, quality_with(tets, moved, star[s], node, place))
                        s += 1
                    if least > best:
                        best = least
                        best_place = place
            if best > worst + LEAST_GAIN:
                moved[node] = best_place
                moves[0] = moves[0] + 1
                for s in range(first, end):
                    quality[star[s]] = quality_with(tets, moved, star[s], node, best_place)
