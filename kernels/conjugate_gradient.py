"""The vector steps of preconditioned conjugate gradients; every scalar stays on the device.

Scalar products are kept by iteration (row) and range (every eighth column: a cache line each), so that no sum has
to be cleared or swapped inside the loop and the same launches serve a CUDA graph."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .arguments import Doubles, Ints, Items, Sums, array_types, struct
from .native import native_kernel, real
from .vectors import add_sum, keep_largest

CHANGE, LENGTH, SUM = range(3)
"""Columns of the measures of a solution: largest squared change and length of a vector, and a sum that shows
NaN."""
SOLUTION_LENGTH, ERROR, LAST_CHANGE, NEGATIVE_CURVATURE, GRADIENT_NORM, RESIDUAL_NORM, ITERATIONS = range(7)
"""The outcome of a solve: length of the longest vector and estimated error of a vector [mm], the last change of a
vector [mm], 1 where a search direction of negative curvature was met, the square root of b . M^-1 b and
of that of the residual, and iterations."""
SLOWEST_WINDOW = wp.constant(0.95)
"""Changes are assumed to shrink at least this fast from window to window."""


PADDING = 8
"""Doubles between two ranges' parts of a scalar product: a cache line."""


@struct
class Dots:
    """Where launches add a scalar product of their vectors, each range its own part, by iteration."""

    iteration: Ints
    """The row that was written last, shape (1,)."""
    products: Sums
    """The products by iteration and range, shape (rows, PADDING * ranges)."""


KEEP_PRODUCT = f"""
    dots.products.data[(wp::int64)dots.products.shape[1] * dots.iteration.data[0] + {PADDING} * slab] += product;
"""
"""Adds a range's part of a scalar product to the row of the iteration."""
TOTAL = f"""
    const auto total = [&](const auto& dots, wp::int64 row) {{
        const int size = dots.products.shape[1];
        double sum = 0.0;  // always in this order, so that every thread finds the same bits
        #pragma unroll 1  // CUDA has one range
        for (int k = 0; k < size; k += {PADDING}) sum += dots.products.data[size * row + k];
        return sum;
    }};
"""
"""Adds up the ranges' parts of one scalar product."""
ALPHA = f"""{TOTAL}
    const int j = p_dot_q.iteration.data[0];
    const double curvature = total(p_dot_q, j);
    // the solution stays where negative curvature was met, until the window is over
    const double alpha = curvature > 0.0 ? total(r_dot_z, j) / curvature : 0.0;
"""
"""The step along the search direction; 0 where its curvature is not positive."""
BETA = f"""{TOTAL}
    const int j = r_dot_z.iteration.data[0];
    const bool negative_curvature = j > 0 && total(p_dot_q, j - 1) < 0.0;
    const double last = j > 0 ? total(r_dot_z, j - 1) : 0.0;
    const double beta = last > 0.0 ? total(r_dot_z, j) / last : 0.0;  // else rounding is left: again along z
"""
"""beta of p = z + beta p, 0 at the first iteration, and whether the last p had negative curvature."""


UPDATE_SEARCH = f"""{BETA}
    if (first == 0) p_dot_q.iteration.data[0] = j;  // which no range reads here
    if (negative_curvature) return;
    real* __restrict__ p = (real*)search.data;
    const real* __restrict__ z = (const real*)preconditioned.data;
    for (int k = 3 * first; k < 3 * end; ++k) p[k] = z[k] + (real)beta * p[k];
"""
UPDATE_SOLUTION = f"""
    const int done = p_dot_q.iteration.data[0];
    if (first == 0) r_dot_z.iteration.data[0] = done + 1;  // which no range reads here
    if (done < 0) return;
    {ALPHA}
    real* __restrict__ x = (real*)solution.data;
    real* __restrict__ r = (real*)residual.data;
    const real* __restrict__ p = (const real*)search.data;
    const real* __restrict__ q = (const real*)product.data;
    for (int k = 3 * first; k < 3 * end; ++k) {{
        x[k] += (real)alpha * p[k];
        r[k] -= (real)alpha * q[k];
    }}
"""


@wp.func_native(TOTAL + "return total(dots, row);")
def total(dots: Dots, row: int) -> wp.float64: ...


@wp.func_native(ALPHA + "return alpha;")
def find_alpha(r_dot_z: Dots, p_dot_q: Dots) -> wp.float64: ...


@wp.func_native(BETA + "return negative_curvature ? NAN : beta;")
def find_beta(r_dot_z: Dots, p_dot_q: Dots) -> wp.float64: ...


@cache
def conjugate_gradient_kernels(scalar: type) -> SimpleNamespace:
    """The kernels of the loop, in its order, in one precision; on CUDA `sparse` updates the search direction."""
    vec3 = wp.types.vector(3, scalar)
    Numbers, Vectors, _ = array_types(scalar)
    module = f"conjugate_gradient_{scalar.__name__}"

    @wp.kernel(module=module, enable_backward=False)
    def reset(items: Items, r_dot_z: Dots, p_dot_q: Dots, outcome: Doubles, running: Ints):
        """Clears what the last solve left; one launch, because clearing each array costs a launch."""
        i = items.first + wp.tid()
        if i < items.end:
            row = i // r_dot_z.products.shape[1]
            column = i % r_dot_z.products.shape[1]
            r_dot_z.products[row, column] = wp.float64(0.0)
            p_dot_q.products[row, column] = wp.float64(0.0)
        if i < outcome.shape[0]:
            outcome[i] = wp.float64(0.0)
        if i == 0:
            r_dot_z.iteration[0] = -1
            p_dot_q.iteration[0] = -1
            running[0] = 1

    @wp.kernel(module=module, enable_backward=False)
    def start(
        items: Items, gradient: Vectors, solution: Vectors, residual: Vectors, search: Vectors, earlier: Vectors
    ):
        """Starts from zero: residual = -gradient (the one minus sign of Newton's method)."""
        i = items.first + wp.tid()
        if i < items.end:
            residual[i] = -gradient[i]
            solution[i] = vec3()
            search[i] = vec3()
            earlier[i] = vec3()

    @native_kernel(module, real(scalar) + UPDATE_SEARCH)
    def update_search(items: Items, r_dot_z: Dots, p_dot_q: Dots, preconditioned: Vectors, search: Vectors):
        """p = z + beta p on the CPU; a direction of negative curvature is kept, for the host to go along it."""

    @native_kernel(module, real(scalar) + UPDATE_SOLUTION)
    def update_solution(
        items: Items,
        r_dot_z: Dots,
        p_dot_q: Dots,
        search: Vectors,
        product: Vectors,
        solution: Vectors,
        residual: Vectors,
    ):
        """x += alpha p, r -= alpha q on the CPU, but before the first iteration."""

    @wp.kernel(module=module, enable_backward=False)
    def step(
        items: Items,
        r_dot_z: Dots,
        p_dot_q: Dots,
        p: Numbers,
        q: Numbers,
        x: Numbers,
        r: Numbers,
        residual: Numbers,
    ):
        """The same on CUDA, with a copy of r that has four numbers a node."""
        k = items.first + wp.tid()
        if k < items.end:
            own = r[k]
            done = p_dot_q.iteration[0]
            if k == 0:
                r_dot_z.iteration[0] = done + 1  # which no thread reads here
            if done >= 0:
                alpha = scalar(find_alpha(r_dot_z, p_dot_q))
                own -= alpha * q[k]
                r[k] = own
                x[k] = x[k] + alpha * p[k]
            residual[4 * (k // 3) + k % 3] = own

    @wp.kernel(module=module, enable_backward=False)
    def measure(items: Items, solution: Vectors, earlier: Vectors, measures: Sums):
        """Longest vector of the solution and of its change since the last window, both squared [mm^2].

        The sum beside them shows what a maximum hides: NaN.
        """
        i = items.first + wp.tid()
        change = wp.float64(0.0)
        length = wp.float64(0.0)
        if i < items.end:
            x = solution[i]
            change = wp.float64(wp.length_sq(x - earlier[i]))
            length = wp.float64(wp.length_sq(x))
            earlier[i] = x
        add_sum(measures, items.slab, SUM, length)
        keep_largest(measures, items.slab, CHANGE, change)
        keep_largest(measures, items.slab, LENGTH, length)

    @wp.kernel(module=module, enable_backward=False)
    def test_convergence(
        items: Items,
        most: int,
        limits: Doubles,
        r_dot_z: Dots,
        p_dot_q: Dots,
        measures: Sums,
        outcome: Doubles,
        running: Ints,
    ):
        """Whether the solve continues: limits are an error [mm], a relative one, and least iterations.

        The error is estimated from how the changes over two windows shrink: a sequence whose changes shrink by q
        each time has change q / (1 - q) to go. The first window therefore never ends a solve, nor does a plateau
        of a badly conditioned one, where the residual has not fallen by the same part. A solution that is not
        finite, or of a preconditioner that rounding has made indefinite, has infinite length."""
        if items.first + wp.tid() >= items.end:
            return
        change = wp.float64(0.0)
        length = wp.float64(0.0)
        finite = wp.float64(0.0)
        for r in range(measures.shape[0]):
            change = wp.max(change, measures[r, CHANGE])
            length = wp.max(length, measures[r, LENGTH])
            finite += measures[r, SUM]
            measures[r, CHANGE] = wp.float64(0.0)
            measures[r, LENGTH] = wp.float64(0.0)
            measures[r, SUM] = wp.float64(0.0)
        change = wp.sqrt(change)
        length = wp.sqrt(length)
        before = outcome[LAST_CHANGE]
        ratio = wp.float64(SLOWEST_WINDOW)  # of the first window, whose shrinking is not known
        if before > wp.float64(0.0):
            ratio = wp.min(change / before, wp.float64(SLOWEST_WINDOW))
        error = change * wp.max(wp.float64(1.0), ratio / (wp.float64(1.0) - ratio))
        outcome[SOLUTION_LENGTH] = length
        outcome[ERROR] = error
        outcome[LAST_CHANGE] = change
        iteration = r_dot_z.iteration[0]
        start = total(r_dot_z, 0)
        now = total(r_dot_z, iteration)
        sound = wp.isfinite(finite) and start >= wp.float64(0.0) and now >= wp.float64(0.0)
        if not sound:
            outcome[SOLUTION_LENGTH] = wp.float64(wp.inf)
        running[0] = 0
        negative_curvature = total(p_dot_q, iteration - 1) < wp.float64(0.0)
        outcome[NEGATIVE_CURVATURE] = wp.where(negative_curvature, wp.float64(1.0), wp.float64(0.0))
        outcome[ITERATIONS] = wp.float64(iteration)
        outcome[GRADIENT_NORM] = wp.sqrt(wp.max(start, wp.float64(0.0)))
        outcome[RESIDUAL_NORM] = wp.sqrt(wp.max(now, wp.float64(0.0)))
        wanted = wp.max(limits[0], limits[1] * length)
        # the changes of an ill-conditioned solve can pause: then the residual has not fallen either
        fallen = now <= limits[1] * limits[1] * start
        early = wp.float64(iteration) < limits[2]
        inside = sound and not negative_curvature and iteration < most
        if inside and (error > wanted or early or not fallen):
            running[0] = 1

    return SimpleNamespace(
        reset=reset,
        start=start,
        update_search=update_search,
        update_solution=update_solution,
        step=step,
        measure=measure,
        test_convergence=test_convergence,
    )
