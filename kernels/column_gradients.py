"""The vector steps of conjugate gradients on several columns, each with scalars of its own; see `columns`.

A column that is done is frozen: its step is 0 and its search direction stays.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

CHANGE, LONGEST = range(2)
"""Rows of the extent of each slot."""
LONG, LEFT, CHANGED, BENT, START, ITERATIONS = range(6)
"""What is told of a column: its longest vector, the error that may be left in one, the last change [mm], 1 where a
search direction of negative curvature was met, r . M^-1 r at the start, and its iterations."""
SLOWEST = wp.constant(0.95)
"""As in `conjugate_gradient`."""


@cache
def column_gradient_kernels(scalar: type, cuda: bool, width: int) -> SimpleNamespace:
    """The kernels of the loop, in its order, in one precision."""
    size = wp.constant(width)
    column: Any = wp.types.vector(width, scalar)
    double: Any = wp.types.vector(width, wp.float64)

    @wp.func
    def total(products: wp.array2d(dtype=double), group: int):
        """Sum of what the slots hold of the products of a group."""
        value = double()
        for slot in range(products.shape[0]):
            value += products[slot, group]
        return value

    @wp.kernel(module="unique", enable_backward=False)
    def begin_kernel(
        first: int,
        end: int,
        slab: int,
        run: int,
        product: wp.array(dtype=column, ndim=2),
        solution: wp.array(dtype=column, ndim=2),
        residual: wp.array(dtype=column, ndim=2),
        earlier: wp.array(dtype=column, ndim=2),
    ):
        """Takes the product with the first guess from the right side."""
        item = first + wp.tid()
        if item < end:
            d = item % solution.shape[1]
            start = item // solution.shape[1] * run
            for i in range(start, wp.min(start + run, solution.shape[0])):
                residual[i, d] -= product[i, d]
                earlier[i, d] = solution[i, d]

    @wp.kernel(module="unique", enable_backward=False)
    def aim_kernel(
        going: wp.array(dtype=wp.int32),
        r_dot_z: wp.array(dtype=double, ndim=2),
        descent: wp.array(dtype=double),
        outcome: wp.array(dtype=wp.float64, ndim=2),
        keep: wp.array(dtype=column),
        take: wp.array(dtype=column),
    ):
        """The factors of p = take z + keep p; a column with a product that is no number is done."""
        g = wp.tid()
        now = total(r_dot_z, g)
        last = descent[g]
        kept = column()
        taken = column()
        for c in range(size):
            n = size * g + c
            if not (wp.isfinite(now[c]) and now[c] >= wp.float64(0.0)):
                going[n] = 0
                outcome[n, LONG] = wp.float64(wp.inf)
            if going[n] == 0:
                kept[c] = scalar(1.0)
            else:
                taken[c] = scalar(1.0)
                if outcome[n, ITERATIONS] == wp.float64(0.0):
                    outcome[n, START] = now[c]
                elif last[c] > wp.float64(0.0):
                    kept[c] = scalar(now[c] / last[c])
                outcome[n, ITERATIONS] += wp.float64(1.0)
        keep[g] = kept
        take[g] = taken
        descent[g] = now
        for slot in range(r_dot_z.shape[0]):
            r_dot_z[slot, g] = double()

    @wp.kernel(module="unique", enable_backward=False)
    def turn_kernel(
        first: int,
        end: int,
        slab: int,
        run: int,
        keep: wp.array(dtype=column),
        take: wp.array(dtype=column),
        preconditioned: wp.array(dtype=column, ndim=2),
        search: wp.array(dtype=column, ndim=2),
    ):
        """p = take z + keep p."""
        item = first + wp.tid()
        if item < end:
            d = item % search.shape[1]
            start = item // search.shape[1] * run
            kept = keep[d // 3]
            taken = take[d // 3]
            for i in range(start, wp.min(start + run, search.shape[0])):
                search[i, d] = wp.cw_mul(taken, preconditioned[i, d]) + wp.cw_mul(kept, search[i, d])

    @wp.kernel(module="unique", enable_backward=False)
    def pace_kernel(
        descent: wp.array(dtype=double),
        p_dot_q: wp.array(dtype=double, ndim=2),
        going: wp.array(dtype=wp.int32),
        outcome: wp.array(dtype=wp.float64, ndim=2),
        step: wp.array(dtype=column),
    ):
        """How far each column steps; one whose search direction has negative curvature is done."""
        g = wp.tid()
        curvature = total(p_dot_q, g)
        fallen = descent[g]
        steps = column()
        for c in range(size):
            n = size * g + c
            if going[n] == 1:
                if curvature[c] > wp.float64(0.0):
                    steps[c] = scalar(fallen[c] / curvature[c])
                elif curvature[c] < wp.float64(0.0):
                    going[n] = 0
                    outcome[n, BENT] = wp.float64(1.0)
        step[g] = steps
        for slot in range(p_dot_q.shape[0]):
            p_dot_q[slot, g] = double()

    @wp.kernel(module="unique", enable_backward=False)
    def advance_kernel(
        first: int,
        end: int,
        slab: int,
        run: int,
        step: wp.array(dtype=column),
        search: wp.array(dtype=column, ndim=2),
        product: wp.array(dtype=column, ndim=2),
        solution: wp.array(dtype=column, ndim=2),
        residual: wp.array(dtype=column, ndim=2),
    ):
        """Steps along the search directions."""
        item = first + wp.tid()
        if item < end:
            d = item % search.shape[1]
            start = item // search.shape[1] * run
            by = step[d // 3]
            for i in range(start, wp.min(start + run, search.shape[0])):
                solution[i, d] += wp.cw_mul(by, search[i, d])
                residual[i, d] -= wp.cw_mul(by, product[i, d])

    @wp.kernel(module="unique", enable_backward=False)
    def window_kernel(
        first: int,
        end: int,
        slab: int,
        groups: int,
        stretch: int,
        solution: wp.array(dtype=column, ndim=2),
        earlier: wp.array(dtype=column, ndim=2),
        extent: wp.array(dtype=column, ndim=3),
    ):
        """Longest vector of each solution and of its change since the last window, both squared [mm^2]."""
        item = first + wp.tid()
        if item < end:
            g = item % groups
            start = item // groups * stretch
            changed = column()
            longest = column()
            for i in range(start, wp.min(start + stretch, solution.shape[0])):
                change = column()
                whole = column()
                for d in range(3 * g, 3 * g + 3):
                    x = solution[i, d]
                    by = x - earlier[i, d]
                    change += wp.cw_mul(by, by)
                    whole += wp.cw_mul(x, x)
                    earlier[i, d] = x
                changed = wp.max(changed, change)
                longest = wp.max(longest, whole)
            if wp.static(cuda):
                wp.atomic_max(extent, 0, CHANGE, g, changed)
                wp.atomic_max(extent, 0, LONGEST, g, longest)
            else:
                extent[slab, CHANGE, g] = wp.max(extent[slab, CHANGE, g], changed)
                extent[slab, LONGEST, g] = wp.max(extent[slab, LONGEST, g], longest)

    @wp.kernel(module="unique", enable_backward=False)
    def decide_kernel(
        most: int,
        limit: wp.array(dtype=wp.float64),
        r_dot_z: wp.array(dtype=double, ndim=2),
        extent: wp.array(dtype=column, ndim=3),
        going: wp.array(dtype=wp.int32),
        outcome: wp.array(dtype=wp.float64, ndim=2),
        go_on: wp.array(dtype=wp.int32),
    ):
        """Which columns may be farther from their ends than their limits, a part of their length each.

        They are judged as `conjugate_gradient.decide` judges its one.
        """
        g = wp.tid()
        now = total(r_dot_z, g)
        changes = column()
        lengths = column()
        for slot in range(extent.shape[0]):
            changes = wp.max(changes, extent[slot, CHANGE, g])
            lengths = wp.max(lengths, extent[slot, LONGEST, g])
            extent[slot, CHANGE, g] = column()
            extent[slot, LONGEST, g] = column()
        for c in range(size):
            n = size * g + c
            if going[n] == 1:
                changed = wp.sqrt(wp.float64(changes[c]))
                longest = wp.sqrt(wp.float64(lengths[c]))
                ratio = wp.float64(SLOWEST)
                if outcome[n, CHANGED] > wp.float64(0.0):
                    ratio = wp.min(changed / outcome[n, CHANGED], wp.float64(SLOWEST))
                left = changed * wp.max(wp.float64(1.0), ratio / (wp.float64(1.0) - ratio))
                outcome[n, LONG] = longest
                outcome[n, LEFT] = left
                outcome[n, CHANGED] = changed
                near = left <= limit[n] * longest and now[c] <= limit[n] * limit[n] * outcome[n, START]
                if near or outcome[n, ITERATIONS] >= wp.float64(most) or not wp.isfinite(longest):
                    going[n] = 0
                else:
                    go_on[0] = 1

    return SimpleNamespace(
        begin=begin_kernel,
        aim=aim_kernel,
        turn=turn_kernel,
        pace=pace_kernel,
        advance=advance_kernel,
        window=window_kernel,
        decide=decide_kernel,
    )
