"""The vector steps of preconditioned conjugate gradients; every scalar stays on the device.

Scalar products are kept by iteration (row) and range (every eighth column: a cache line each), so that no sum has
to be cleared or swapped inside the loop and the same launches serve a CUDA graph."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .vectors import max_reducer, sum_reducer

CHANGE, LENGTH, SUM = range(3)
"""Columns of the measures of a solution: largest squared change and length of a vector, and a sum that shows
NaN."""
SOLUTION_LENGTH, ERROR, LAST_CHANGE, NEGATIVE_CURVATURE, NORM, LEFT, ITERATIONS = range(7)
"""The outcome of a solve: length of the longest vector and estimated error of a vector [mm], the last change of a
vector [mm], 1 where a search direction of negative curvature was met, the square root of b . M^-1 b and
of that of the residual, and iterations."""
SLOWEST = wp.constant(0.95)
"""Changes are assumed to shrink at least this fast from window to window."""


@wp.func
def total(products: wp.array2d(dtype=wp.float64), row: int, ranges: int):
    """Sum over the ranges of one scalar product."""
    value = wp.float64(0.0)
    for r in range(ranges):  # always in this order, so that every thread finds the same bits
        value += products[row, 8 * r]
    return value


@wp.func
def find_beta(
    r_dot_z: wp.array2d(dtype=wp.float64), p_dot_q: wp.array2d(dtype=wp.float64), iteration: int, ranges: int
):
    """beta of p = z + beta p, 0 at the first iteration, and whether the last p had negative curvature."""
    beta = wp.float64(0.0)
    negative_curvature = False
    if iteration > 0:
        negative_curvature = total(p_dot_q, iteration - 1, ranges) < wp.float64(0.0)
        last = total(r_dot_z, iteration - 1, ranges)
        if last > wp.float64(0.0):  # otherwise rounding is all that is left: start again along z
            beta = total(r_dot_z, iteration, ranges) / last
    return beta, negative_curvature


@wp.func
def find_alpha(
    r_dot_z: wp.array2d(dtype=wp.float64), p_dot_q: wp.array2d(dtype=wp.float64), iteration: int, ranges: int
):
    """The step along the search direction; 0 where its curvature is not positive."""
    curvature = total(p_dot_q, iteration, ranges)
    alpha = wp.float64(0.0)  # the solution stays where negative curvature was met, until the window is over
    if curvature > wp.float64(0.0):
        alpha = total(r_dot_z, iteration, ranges) / curvature
    return alpha


@cache
def conjugate_gradient_kernels(scalar: type, cuda: bool) -> SimpleNamespace:
    """The kernels of the loop, in its order, in one precision; on CUDA `sparse` and `multigrid` do the vector
    steps."""
    add, keep_largest = sum_reducer(cuda), max_reducer(cuda)
    vec3 = wp.types.vector(3, scalar)
    module = f"conjugate_gradient_{scalar.__name__}_{'cuda' if cuda else 'cpu'}"

    @wp.kernel(module=module, enable_backward=False)
    def reset_kernel(
        first: int,
        end: int,
        slab: int,
        r_dot_z: wp.array(dtype=wp.float64),
        p_dot_q: wp.array(dtype=wp.float64),
        iteration: wp.array(dtype=wp.int32),
        outcome: wp.array(dtype=wp.float64),
        running: wp.array(dtype=wp.int32),
    ):
        """Clears what the last solve left; one launch, because clearing each array costs a launch."""
        i = first + wp.tid()
        if i < end:
            r_dot_z[i] = wp.float64(0.0)
            p_dot_q[i] = wp.float64(0.0)
        if i < outcome.shape[0]:
            outcome[i] = wp.float64(0.0)
        if i == 0:
            iteration[0] = -1  # it is counted where the preconditioner is applied
            running[0] = 1

    @wp.kernel(module=module, enable_backward=False)
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

    real = "float" if scalar is wp.float32 else "double"

    @wp.func_native(f"""
    {real}* __restrict__ p = search.data;
    const {real}* __restrict__ z = preconditioned.data;
    for (wp::int32 k = 3 * first; k < 3 * end; ++k) p[k] = z[k] + beta * p[k];
    """)
    def add_to_search(
        first: wp.int32,
        end: wp.int32,
        beta: scalar,
        preconditioned: wp.array(dtype=scalar),
        search: wp.array(dtype=scalar),
    ): ...

    @wp.func_native(f"""
    {real}* __restrict__ x = solution.data;
    {real}* __restrict__ r = residual.data;
    const {real}* __restrict__ p = search.data;
    const {real}* __restrict__ q = product.data;
    for (wp::int32 k = 3 * first; k < 3 * end; ++k) {{
        x[k] += alpha * p[k];
        r[k] -= alpha * q[k];
    }}
    """)
    def step_along_search(
        first: wp.int32,
        end: wp.int32,
        alpha: scalar,
        search: wp.array(dtype=scalar),
        product: wp.array(dtype=scalar),
        solution: wp.array(dtype=scalar),
        residual: wp.array(dtype=scalar),
    ): ...

    @wp.kernel(module=module, enable_backward=False)
    def update_search_kernel(
        first: int,
        end: int,
        slab: int,
        ranges: int,
        iteration: wp.array(dtype=wp.int32),
        r_dot_z: wp.array(dtype=wp.float64, ndim=2),
        p_dot_q: wp.array(dtype=wp.float64, ndim=2),
        preconditioned: wp.array(dtype=scalar),
        search: wp.array(dtype=scalar),
    ):
        """p = z + beta p, a loop over the nodes of the range.

        A direction of negative curvature is kept, for the host to go along it.
        """
        beta, negative_curvature = find_beta(r_dot_z, p_dot_q, iteration[0], ranges)
        if not negative_curvature:
            add_to_search(first, end, scalar(beta), preconditioned, search)

    @wp.kernel(module=module, enable_backward=False)
    def update_solution_kernel(
        first: int,
        end: int,
        slab: int,
        ranges: int,
        iteration: wp.array(dtype=wp.int32),
        r_dot_z: wp.array(dtype=wp.float64, ndim=2),
        p_dot_q: wp.array(dtype=wp.float64, ndim=2),
        search: wp.array(dtype=scalar),
        product: wp.array(dtype=scalar),
        solution: wp.array(dtype=scalar),
        residual: wp.array(dtype=scalar),
    ):
        """x += alpha p, r -= alpha q but before the first iteration, a loop over the nodes of the range."""
        if iteration[0] >= 0:
            alpha = find_alpha(r_dot_z, p_dot_q, iteration[0], ranges)
            step_along_search(first, end, scalar(alpha), search, product, solution, residual)

    @wp.kernel(module=module, enable_backward=False)
    def measure_kernel(
        first: int,
        end: int,
        slab: int,
        solution: wp.array(dtype=vec3),
        earlier: wp.array(dtype=vec3),
        measures: wp.array(dtype=wp.float64, ndim=2),
    ):
        """Longest vector of the solution and of its change since the last window, both squared [mm^2].

        The sum beside them shows what a maximum hides: NaN.
        """
        i = first + wp.tid()
        change = wp.float64(0.0)
        length = wp.float64(0.0)
        if i < end:
            x = solution[i]
            change = wp.float64(wp.length_sq(x - earlier[i]))
            length = wp.float64(wp.length_sq(x))
            earlier[i] = x
        add(measures, slab, SUM, length)
        keep_largest(measures, slab, CHANGE, change)
        keep_largest(measures, slab, LENGTH, length)

    @wp.kernel(module=module, enable_backward=False)
    def test_convergence_kernel(
        ranges: int,
        most: int,
        limits: wp.array(dtype=wp.float64),
        r_dot_z: wp.array(dtype=wp.float64, ndim=2),
        p_dot_q: wp.array(dtype=wp.float64, ndim=2),
        iteration: wp.array(dtype=wp.int32),
        measures: wp.array(dtype=wp.float64, ndim=2),
        outcome: wp.array(dtype=wp.float64),
        running: wp.array(dtype=wp.int32),
    ):
        """Whether the solve continues: limits are an error [mm], a relative one, and least iterations.

        The error is estimated from how the changes over two windows shrink: a sequence whose changes shrink by q
        each time has change q / (1 - q) to go. The first window therefore never ends a solve, nor does a plateau
        of a badly conditioned one, where the residual has not fallen by the same part. A solution that is not
        finite, or of a preconditioner that rounding has made indefinite, has infinite length."""
        change = wp.float64(0.0)
        length = wp.float64(0.0)
        finite = wp.float64(0.0)
        for r in range(ranges):
            change = wp.max(change, measures[r, CHANGE])
            length = wp.max(length, measures[r, LENGTH])
            finite += measures[r, SUM]
            measures[r, CHANGE] = wp.float64(0.0)
            measures[r, LENGTH] = wp.float64(0.0)
            measures[r, SUM] = wp.float64(0.0)
        change = wp.sqrt(change)
        length = wp.sqrt(length)
        before = outcome[LAST_CHANGE]
        ratio = wp.float64(SLOWEST)  # of the first window, whose shrinking is not known
        if before > wp.float64(0.0):
            ratio = wp.min(change / before, wp.float64(SLOWEST))
        error = change * wp.max(wp.float64(1.0), ratio / (wp.float64(1.0) - ratio))
        outcome[SOLUTION_LENGTH] = length
        outcome[ERROR] = error
        outcome[LAST_CHANGE] = change
        start = total(r_dot_z, 0, ranges)
        now = total(r_dot_z, iteration[0], ranges)
        sound = wp.isfinite(finite) and start >= wp.float64(0.0) and now >= wp.float64(0.0)
        if not sound:
            outcome[SOLUTION_LENGTH] = wp.float64(wp.inf)
        running[0] = 0
        negative_curvature = total(p_dot_q, iteration[0] - 1, ranges) < wp.float64(0.0)
        outcome[NEGATIVE_CURVATURE] = wp.where(negative_curvature, wp.float64(1.0), wp.float64(0.0))
        outcome[ITERATIONS] = wp.float64(iteration[0])
        outcome[NORM] = wp.sqrt(wp.max(start, wp.float64(0.0)))
        outcome[LEFT] = wp.sqrt(wp.max(now, wp.float64(0.0)))
        wanted = wp.max(limits[0], limits[1] * length)
        # the changes of an ill-conditioned solve can pause: then the residual has not fallen either
        fallen = now <= limits[1] * limits[1] * start
        early = wp.float64(iteration[0]) < limits[2]
        inside = sound and not negative_curvature and iteration[0] < most
        if inside and (error > wanted or early or not fallen):
            running[0] = 1

    return SimpleNamespace(
        reset=reset_kernel,
        start=start_kernel,
        update_search=update_search_kernel,
        update_solution=update_solution_kernel,
        measure=measure_kernel,
        test_convergence=test_convergence_kernel,
    )
