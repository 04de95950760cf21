"""Moving nodes of a tetrahedral mesh to improve the shape of its tetrahedra."""

import warp as wp

from .arguments import Doubles, Ints, Points

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
def mean_ratios(corners: wp.array2d[wp.vec3d], quality: Doubles):
    """Quality of tetrahedra by their corners."""
    t = wp.tid()
    quality[t] = mean_ratio(corners[t, 0], corners[t, 1], corners[t, 2], corners[t, 3])


@wp.func
def quality_with(tets: wp.array[wp.vec4i], nodes: Points, tet: int, node: int, place: wp.vec3d) -> wp.float64:
    """Quality of a tetrahedron with one of its nodes at another place."""
    n = tets[tet]
    i = wp.where(n[0] == node, place, nodes[n[0]])
    j = wp.where(n[1] == node, place, nodes[n[1]])
    k = wp.where(n[2] == node, place, nodes[n[2]])
    m = wp.where(n[3] == node, place, nodes[n[3]])
    return mean_ratio(i, j, k, m)


@wp.kernel(enable_backward=False)
def move_nodes(
    turns: Ints,
    goal: wp.float64,
    tets: wp.array[wp.vec4i],
    start: Ints,
    star: Ints,
    around: Points,
    reach: Doubles,
    start_places: Points,
    moved: Points,
    quality: Doubles,
    moves: Ints,
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
            centre = moved[node]
            size = wp.float64(0.0)
            for s in range(first, end):
                n = tets[star[s]]
                for c in range(4):
                    size += wp.length(moved[n[c]] - centre)
            size = size / wp.float64(3 * (end - first))
            best = worst + LEAST_GAIN
            best_place = centre
            for k in range(around.shape[0]):
                place = centre + size * around[k]
                if wp.length(place - start_places[node]) <= reach[node]:
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
