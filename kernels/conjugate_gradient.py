"""The vector steps of preconditioned conjugate gradients; every scalar stays on the device.

Products are kept by iteration (row) and range (every eighth column: a cache line each), so that no
sum has to be cleared or swapped inside the loop and the same launches serve a CUDA graph.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .reduction import adder, largest_keeper

CHANGE, LONGEST, SUM = range(3)
"""Columns of the extent of a solution."""
LONG, LEFT, CHANGED, BENT, NORM, ITERATIONS = range(6)
"""What is told of a solution: its longest vector, the error that may be left in one, the last change [mm], 1 where
a search direction of negative curvature was met, the square root of g . M^-1 g, and the iterations it took."""
SLOWEST = wp.constant(0.95)
"""Changes are taken to shrink at least this fast from window to window."""


RUN = 16
"""Numbers that an item of `advance` and `turn` holds, a vector register. An item costs more than what it does on
the CPU, where the loop over items has no vector instructions."""


@wp.func
def total(products: wp.array2d(dtype=wp.float64), row: int, ranges: int):
    """Sum of what the ranges hold of one product."""
    value = wp.float64(0.0)
    for r in range(ranges):
        value += products[row, 8 * r]
    return value


@wp.func
def turning(
    r_dot_z: wp.array2d(dtype=wp.float64), p_dot_q: wp.array2d(dtype=wp.float64), iteration: int, ranges: int
):
    """beta of p = z + beta p, 0 at the first iteration, and whether p is kept, as one of negative curvature."""
    beta = wp.float64(0.0)
    bent = False
    if iteration > 0:
        bent = total(p_dot_q, iteration - 1, ranges) < wp.float64(0.0)
        last = total(r_dot_z, iteration - 1, ranges)
        if last > wp.float64(0.0):
            beta = total(r_dot_z, iteration, ranges) / last
    return beta, bent


@wp.func
def stepping(
    r_dot_z: wp.array2d(dtype=wp.float64), p_dot_q: wp.array2d(dtype=wp.float64), iteration: int, ranges: int
):
    """How far to go along the search direction: not at all where its curvature is not positive."""
    curvature = total(p_dot_q, iteration, ranges)
    step = wp.float64(0.0)
    if curvature > wp.float64(0.0):
        step = total(r_dot_z, iteration, ranges) / curvature
    return step


@cache
def conjugate_gradient_kernels(scalar: type, cuda: bool) -> SimpleNamespace:
    """The kernels of the loop, in its order, in one precision; for CUDA see `all_grids` and `row_product`, too."""
    add, keep_largest = adder(cuda), largest_keeper(cuda)
    vec3 = wp.types.vector(3, scalar)
    run = wp.types.vector(RUN, scalar)

    @wp.kernel(module="unique", enable_backward=False)
    def forget_kernel(
        first: int,
        end: int,
        slab: int,
        r_dot_z: wp.array(dtype=wp.float64),
        p_dot_q: wp.array(dtype=wp.float64),
        iteration: wp.array(dtype=wp.int32),
        outcome: wp.array(dtype=wp.float64),
        go_on: wp.array(dtype=wp.int32),
    ):
        """Clears what is known of the last solve; in one launch, as each array of its own takes as long."""
        i = first + wp.tid()
        if i < end:
            r_dot_z[i] = wp.float64(0.0)
            p_dot_q[i] = wp.float64(0.0)
        if i < outcome.shape[0]:
            outcome[i] = wp.float64(0.0)
        if i == 0:
            iteration[0] = 0
            go_on[0] = 1

    @wp.kernel(module="unique", enable_backward=False)
    def start_kernel(
        first: int,
        end: int,
        slab: int,
        gradient: wp.array(dtype=vec3),
        solution: wp.array(dtype=vec3),
        residual: wp.array(dtype=vec3),
        search: wp.array(dtype=vec3),
        earlier: wp.array(dtype=vec3),
    ):
        """Starts from zero: residual = -gradient (the one minus sign of Newton's method)."""
        i = first + wp.tid()
        if i < end:
            residual[i] = -gradient[i]
            solution[i] = vec3()
            search[i] = vec3()
            earlier[i] = vec3()

    @wp.kernel(module="unique", enable_backward=False)
    def advance_kernel(
        first: int,
        end: int,
        slab: int,
        ranges: int,
        iteration: wp.array(dtype=wp.int32),
        r_dot_z: wp.array(dtype=wp.float64, ndim=2),
        p_dot_q: wp.array(dtype=wp.float64, ndim=2),
        search: wp.array(dtype=run),
        product: wp.array(dtype=run),
        solution: wp.array(dtype=run),
        residual: wp.array(dtype=run),
    ):
        """Steps along the search direction."""
        i = first + wp.tid()
        j = iteration[0]
        if i < end:
            step = scalar(stepping(r_dot_z, p_dot_q, j, ranges))
            solution[i] += step * search[i]
            residual[i] -= step * product[i]

    @wp.kernel(module="unique", enable_backward=False)
    def turn_kernel(
        first: int,
        end: int,
        slab: int,
        ranges: int,
        iteration: wp.array(dtype=wp.int32),
        r_dot_z: wp.array(dtype=wp.float64, ndim=2),
        p_dot_q: wp.array(dtype=wp.float64, ndim=2),
        preconditioned: wp.array(dtype=run),
        search: wp.array(dtype=run),
    ):
        """p = z + beta p; a direction of negative curvature is kept."""
        i = first + wp.tid()
        if i < end:
            beta, bent = turning(r_dot_z, p_dot_q, iteration[0], ranges)
            if not bent:
                search[i] = preconditioned[i] + scalar(beta) * search[i]

    @wp.kernel(module="unique", enable_backward=False)
    def count_kernel(window: int, iteration: wp.array(dtype=wp.int32), within: wp.array(dtype=wp.int32)):
        """Counts the iteration just done; `within` tells whether its window goes on."""
        iteration[0] = iteration[0] + 1
        within[0] = iteration[0] % window

    @wp.kernel(module="unique", enable_backward=False)
    def window_kernel(
        first: int,
        end: int,
        slab: int,
        solution: wp.array(dtype=vec3),
        earlier: wp.array(dtype=vec3),
        extent: wp.array(dtype=wp.float64, ndim=2),
    ):
        """Longest vector of the solution and of its change since the last window, both squared [mm^2].

        The sum beside them shows what a maximum hides: NaN.
        """
        i = first + wp.tid()
        changed = wp.float64(0.0)
        whole = wp.float64(0.0)
        if i < end:
            x = solution[i]
            changed = wp.float64(wp.length_sq(x - earlier[i]))
            whole = wp.float64(wp.length_sq(x))
            earlier[i] = x
        add(extent, slab, SUM, whole)
        keep_largest(extent, slab, CHANGE, changed)
        keep_largest(extent, slab, LONGEST, whole)

    @wp.kernel(module="unique", enable_backward=False)
    def decide_kernel(
        ranges: int,
        most: int,
        limits: wp.array(dtype=wp.float64),
        r_dot_z: wp.array(dtype=wp.float64, ndim=2),
        p_dot_q: wp.array(dtype=wp.float64, ndim=2),
        iteration: wp.array(dtype=wp.int32),
        extent: wp.array(dtype=wp.float64, ndim=2),
        outcome: wp.array(dtype=wp.float64),
        go_on: wp.array(dtype=wp.int32),
    ):
        """Whether the solution may be farther from its end than the limits: in mm, or as a part of its length.

        What is left is judged by how the changes over two windows shrink: a sequence whose changes shrink
        by q each time has change q / (1 - q) before it. The first window therefore never ends a solve, nor
        does a plateau of a badly conditioned one, where the residual has not fallen by the same part. A solution
        that is not finite, or of a preconditioner that rounding has made indefinite, has infinite length.
        """
        changed = wp.float64(0.0)
        longest = wp.float64(0.0)
        finite = wp.float64(0.0)
        for r in range(ranges):
            changed = wp.max(changed, extent[r, CHANGE])
            longest = wp.max(longest, extent[r, LONGEST])
            finite += extent[r, SUM]
            extent[r, CHANGE] = wp.float64(0.0)
            extent[r, LONGEST] = wp.float64(0.0)
            extent[r, SUM] = wp.float64(0.0)
        changed = wp.sqrt(changed)
        longest = wp.sqrt(longest)
        before = outcome[CHANGED]
        ratio = wp.float64(SLOWEST)
        if before > wp.float64(0.0):
            ratio = wp.min(changed / before, wp.float64(SLOWEST))
        left = changed * wp.max(wp.float64(1.0), ratio / (wp.float64(1.0) - ratio))
        outcome[LONG] = longest
        outcome[LEFT] = left
        outcome[CHANGED] = changed
        start = total(r_dot_z, 0, ranges)
        now = total(r_dot_z, iteration[0], ranges)
        sound = wp.isfinite(finite) and start >= wp.float64(0.0) and now >= wp.float64(0.0)
        if not sound:
            outcome[LONG] = wp.float64(wp.inf)
        go_on[0] = 0
        bent = total(p_dot_q, iteration[0] - 1, ranges) < wp.float64(0.0)
        outcome[BENT] = wp.float64(0.0)
        if bent:
            outcome[BENT] = wp.float64(1.0)
        outcome[ITERATIONS] = wp.float64(iteration[0])
        outcome[NORM] = wp.sqrt(wp.max(start, wp.float64(0.0)))
        limit = wp.max(limits[0], limits[1] * longest)
        fallen = now <= limits[1] * limits[1] * start
        early = wp.float64(iteration[0]) < limits[2]
        if sound and not bent and (left > limit or early or not fallen) and iteration[0] < most:
            go_on[0] = 1

    return SimpleNamespace(
        forget=forget_kernel,
        start=start_kernel,
        advance=advance_kernel,
        turn=turn_kernel,
        count=count_kernel,
        window=window_kernel,
        decide=decide_kernel,
    )
