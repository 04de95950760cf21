"""The vector steps of preconditioned conjugate gradients; every scalar stays on the device.

Products are kept by iteration (row) and range (every eighth column: a cache line each), so that no
sum has to be cleared or swapped inside the loop and the same launches serve a CUDA graph.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp


@wp.func
def total(products: wp.array2d(dtype=wp.float64), row: int, ranges: int):
    """Sum of what the ranges hold of one product."""
    value = wp.float64(0.0)
    for r in range(ranges):
        value += products[row, 8 * r]
    return value


@cache
def conjugate_gradient_kernels(scalar: type) -> SimpleNamespace:
    """The kernels of the loop, in one precision; `coarse` is for CUDA, where no BLAS is at hand."""
    vec3 = wp.types.vector(3, scalar)
    vec4 = wp.types.vector(4, scalar)
    mat33 = wp.types.matrix((3, 3), scalar)

    @wp.kernel(module="unique", enable_backward=False)
    def start_kernel(
        first: int,
        end: int,
        slab: int,
        gradient: wp.array(dtype=vec3, ndim=2),
        aggregate: wp.array(dtype=wp.int32),
        mode: wp.array(dtype=vec4),
        solution: wp.array(dtype=vec3),
        residual: wp.array(dtype=vec3),
        search: wp.array(dtype=vec3),
        coarse_residual: wp.array(dtype=vec3, ndim=2),
    ):
        """Starts from zero: residual = -gradient (the one minus sign), restricted to the aggregates."""
        i = first + wp.tid()
        if i < end:
            r = -gradient[0, i]
            solution[i] = vec3()
            search[i] = vec3()
            residual[i] = r
            a = 4 * aggregate[i]
            m = mode[i]
            for k in range(4):
                wp.atomic_add(coarse_residual, slab, a + k, m[k] * r)

    @wp.kernel(module="unique", enable_backward=False)
    def advance_kernel(
        first: int,
        end: int,
        slab: int,
        ranges: int,
        iteration: wp.array(dtype=wp.int32),
        r_dot_z: wp.array(dtype=wp.float64, ndim=2),
        p_dot_q: wp.array(dtype=wp.float64, ndim=2),
        aggregate: wp.array(dtype=wp.int32),
        mode: wp.array(dtype=vec4),
        search: wp.array(dtype=vec3),
        product: wp.array(dtype=vec3),
        solution: wp.array(dtype=vec3),
        residual: wp.array(dtype=vec3),
        coarse_residual: wp.array(dtype=vec3, ndim=2),
    ):
        """Steps along the search direction and restricts the new residual to the aggregates."""
        i = first + wp.tid()
        j = iteration[0]
        if i < end:
            curvature = total(p_dot_q, j, ranges)
            step = scalar(0.0)
            if curvature > wp.float64(0.0):
                step = scalar(total(r_dot_z, j, ranges) / curvature)
            solution[i] += step * search[i]
            r = residual[i] - step * product[i]
            residual[i] = r
            a = 4 * aggregate[i]
            m = mode[i]
            for k in range(4):
                wp.atomic_add(coarse_residual, slab, a + k, m[k] * r)

    @wp.kernel(module="unique", enable_backward=False)
    def precondition_kernel(
        first: int,
        end: int,
        slab: int,
        iteration: wp.array(dtype=wp.int32),
        ahead: int,
        inverse_diagonal: wp.array(dtype=mat33),
        aggregate: wp.array(dtype=wp.int32),
        mode: wp.array(dtype=vec4),
        coarse_solution: wp.array(dtype=vec3),
        residual: wp.array(dtype=vec3),
        preconditioned: wp.array(dtype=vec3),
        r_dot_z: wp.array(dtype=wp.float64, ndim=2),
    ):
        """z = D^-1 r + P (P^T H P)^-1 P^T r, the two-level preconditioner, and this range's part of r . z."""
        i = first + wp.tid()
        value = wp.float64(0.0)
        if i < end:
            r = residual[i]
            z = inverse_diagonal[i] * r
            a = 4 * aggregate[i]
            m = mode[i]
            for k in range(4):
                z += m[k] * coarse_solution[a + k]
            preconditioned[i] = z
            value = wp.float64(wp.dot(r, z))
        wp.tile_atomic_add(r_dot_z[iteration[0] + ahead], wp.tile_sum(wp.tile(value)), offset=(8 * slab,))

    @wp.kernel(module="unique", enable_backward=False)
    def turn_kernel(
        first: int,
        end: int,
        slab: int,
        ranges: int,
        iteration: wp.array(dtype=wp.int32),
        r_dot_z: wp.array(dtype=wp.float64, ndim=2),
        preconditioned: wp.array(dtype=vec3),
        search: wp.array(dtype=vec3),
    ):
        """p = z + beta p, with beta = 0 at the first iteration."""
        i = first + wp.tid()
        j = iteration[0]
        if i < end:
            beta = scalar(0.0)
            if j > 0:
                beta = scalar(total(r_dot_z, j, ranges) / total(r_dot_z, j - 1, ranges))
            search[i] = preconditioned[i] + beta * search[i]

    @wp.kernel(module="unique", enable_backward=False)
    def count_kernel(
        ranges: int,
        most: int,
        reduction: wp.array(dtype=wp.float64),
        r_dot_z: wp.array(dtype=wp.float64, ndim=2),
        p_dot_q: wp.array(dtype=wp.float64, ndim=2),
        iteration: wp.array(dtype=wp.int32),
        go_on: wp.array(dtype=wp.int32),
    ):
        """Counts the iteration just done and says whether another is wanted.

        It ends when r . z has fallen by the square of the asked reduction, where the matrix shows no
        curvature, and where a number is not finite (a comparison with NaN is false).
        """
        done = iteration[0] + 1
        iteration[0] = done
        now = total(r_dot_z, done, ranges)
        enough = reduction[0] * reduction[0] * total(r_dot_z, 0, ranges)
        curved = total(p_dot_q, done - 1, ranges) > wp.float64(0.0)
        go_on[0] = 0
        if now > enough and curved and done < most:
            go_on[0] = 1

    @wp.kernel(module="unique", enable_backward=False)
    def coarse_kernel(
        size: int,
        chunk: int,
        slabs: int,
        inverse: wp.array(dtype=scalar, ndim=2),
        coarse_residual: wp.array(dtype=scalar, ndim=2),
        coarse_solution: wp.array(dtype=scalar),
    ):
        """Adds one chunk of columns of the dense product (P^T H P)^-1 P^T r; neighbours read neighbours."""
        t = wp.tid()
        i = t % size
        start = (t // size) * chunk
        value = scalar(0.0)
        for k in range(start, wp.min(start + chunk, size)):
            r = coarse_residual[0, k]
            for other in range(1, slabs):
                r += coarse_residual[other, k]
            value += inverse[k, i] * r
        wp.atomic_add(coarse_solution, i, value)

    return SimpleNamespace(
        start=start_kernel,
        advance=advance_kernel,
        precondition=precondition_kernel,
        turn=turn_kernel,
        count=count_kernel,
        coarse=coarse_kernel,
    )
