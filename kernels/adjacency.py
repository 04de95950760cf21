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
def find(
    low: wp.array(dtype=wp.int32), high: wp.array(dtype=wp.int32), first: int, end: int, one: int, other: int
) -> int:
    """Where two numbers stand together in a list; its end where they do not."""
    k = int(first)
    while k < end and (low[k] != one or high[k] != other):
        k += 1
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

    `low`, `high` and `count` are room for three edges or faces of every corner.
    """
    i = first + wp.tid()
    if i < end:
        begin = 3 * start[i]
        for faces in range(2):
            stop = int(begin)
            for writes in range(2):
                for e in range(start[i], start[i + 1]):
                    t = around[e] // 4
                    a = around[e] % 4
                    tet = tets[t]
                    for b in range(4):
                        if b != a:
                            one = tet[b]
                            other = wp.int32(0)
                            if faces == 1:
                                one, other = others_of_face(tet, b, a)
                            if one > i:
                                k = find(low, high, begin, stop, one, other)
                                if writes == 1:
                                    if faces == 1:
                                        face[t, b] = wp.uint16(count[k])
                                    else:
                                        across = wp.where(wp.min(a, b) == 0, a + b - 1, a + b)
                                        edge[t, across] = wp.uint16(count[k])
                                elif k < stop:
                                    count[k] += 1
                                else:
                                    low[k] = one
                                    high[k] = other
                                    count[k] = 1
                                    stop += 1


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
                    high = row_start[i + 1] - row - 1
                    while low < high:
                        middle = (low + high) // 2
                        if neighbours[begin + middle] < n:
                            low = middle + 1
                        else:
                            high = middle
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
