"""What tetrahedra share: which nodes are neighbours, and how many tetrahedra an edge or a face has.

Lists are made node by node of the tetrahedra around each: short ones, in place of sorting all of a mesh. What is
found does not depend on the order of the tetrahedra around a node.
"""

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
