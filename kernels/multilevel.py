"""Transfers between levels of the preconditioner on the CPU (for CUDA: `all_grids`), and matrices of its grids."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .reduction import adder

vec8i = wp.types.vector(8, wp.int32)
STRIP = 16
"""Rows of the dense product that one item of the CPU adds up."""


@cache
def multilevel_kernels(scalar: type) -> SimpleNamespace:
    """The kernels of the preconditioner, in one precision; those that apply it are for the CPU."""
    add = adder(False)
    vec3 = wp.types.vector(3, scalar)
    vec8 = wp.types.vector(8, scalar)
    mat33 = wp.types.matrix((3, 3), scalar)
    strip = wp.types.vector(STRIP, scalar)

    @wp.kernel(module="unique", enable_backward=False)
    def restrict_kernel(
        first: int,
        end: int,
        slab: int,
        row_start: wp.array(dtype=wp.int32),
        point: wp.array(dtype=wp.int32),
        weight: wp.array(dtype=scalar),
        residual: wp.array(dtype=vec3),
        coarse_residual: wp.array(dtype=vec3),
    ):
        """P^T r: every grid vertex gathers the residual of the points it reaches."""
        v = first + wp.tid()
        if v < end:
            total = vec3()
            for k in range(row_start[v], row_start[v + 1]):
                total += weight[k] * residual[point[k]]
            coarse_residual[v] = total

    @wp.kernel(module="unique", enable_backward=False)
    def prolong_kernel(
        first: int,
        end: int,
        slab: int,
        inverse_diagonal: wp.array(dtype=mat33),
        vertex: wp.array(dtype=vec8i),
        weight: wp.array(dtype=vec8),
        coarse: wp.array(dtype=vec3),
        residual: wp.array(dtype=vec3),
        correction: wp.array(dtype=vec3),
        iteration: wp.array(dtype=wp.int32),
        products: wp.array(dtype=wp.float64, ndim=2),
    ):
        """z = D^-1 r + P z_coarse, and this range's part of r . z, kept by iteration."""
        i = first + wp.tid()
        value = wp.float64(0.0)
        if i < end:
            r = residual[i]
            z = inverse_diagonal[i] * r
            at = vertex[i]
            w = weight[i]
            for k in range(8):
                z += w[k] * coarse[at[k]]
            correction[i] = z
            value = wp.float64(wp.dot(r, z))
        add(products, iteration[0], 8 * slab, value)

    @wp.kernel(module="unique", enable_backward=False)
    def grid_diagonal_kernel(
        row_start: wp.array(dtype=wp.int32),
        columns: wp.array(dtype=wp.int32),
        blocks: wp.array(dtype=mat33, ndim=2),
        vertex: wp.array(dtype=vec8i),
        weight: wp.array(dtype=vec8),
        diagonal: wp.array(dtype=mat33),
    ):
        """Adds what the matrix row of one node gives to the diagonal blocks of P^T H P."""
        i = wp.tid()
        own = vertex[i]
        w = weight[i]
        for n in range(row_start[i], row_start[i + 1]):
            other = vertex[columns[n]]
            v = weight[columns[n]]
            block = blocks[0, n]
            for k in range(8):
                for m in range(8):
                    if own[k] == other[m]:
                        wp.atomic_add(diagonal, own[k], (w[k] * v[m]) * block)

    @wp.kernel(module="unique", enable_backward=False)
    def grid_matrix_kernel(
        row_start: wp.array(dtype=wp.int32),
        columns: wp.array(dtype=wp.int32),
        blocks: wp.array(dtype=mat33, ndim=2),
        vertex: wp.array(dtype=vec8i),
        weight: wp.array(dtype=vec8),
        matrix: wp.array(dtype=wp.float64, ndim=2),
    ):
        """Adds what the matrix row of one node gives to P^T H P, dense."""
        i = wp.tid()
        own = vertex[i]
        w = weight[i]
        for n in range(row_start[i], row_start[i + 1]):
            other = vertex[columns[n]]
            v = weight[columns[n]]
            block = blocks[0, n]
            for k in range(8):
                for m in range(8):
                    factor = w[k] * v[m]
                    for a in range(3):
                        for b in range(3):
                            wp.atomic_add(
                                matrix, 3 * own[k] + a, 3 * other[m] + b, wp.float64(factor * block[a, b])
                            )

    @wp.kernel(module="unique", enable_backward=False)
    def dense_strip_kernel(
        first: int,
        end: int,
        slab: int,
        size: int,
        inverse: wp.array(dtype=strip, ndim=2),
        residual: wp.array(dtype=scalar),
        solution: wp.array(dtype=strip),
    ):
        """STRIP rows of a dense product: one vector register of sums, read from front to back."""
        b = first + wp.tid()
        if b < end:
            total = strip()
            for k in range(size):
                total += inverse[b, k] * residual[k]
            solution[b] = total

    return SimpleNamespace(
        restrict=restrict_kernel,
        prolong=prolong_kernel,
        grid_diagonal=grid_diagonal_kernel,
        grid_matrix=grid_matrix_kernel,
        dense_strip=dense_strip_kernel,
    )
