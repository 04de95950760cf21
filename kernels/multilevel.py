"""Matrices of the preconditioner's grids, and on the CPU the dense product (see `row_loops`)."""

from functools import cache
from types import SimpleNamespace

import warp as wp

vec8i = wp.types.vector(8, wp.int32)
STRIP = 16
"""Rows of the dense product that one item of the CPU adds up."""


@cache
def multilevel_kernels(scalar: type) -> SimpleNamespace:
    """The kernels of the preconditioner, in one precision; `dense_strip` is for the CPU."""
    vec8 = wp.types.vector(8, scalar)
    mat33 = wp.types.matrix((3, 3), scalar)
    strip = wp.types.vector(STRIP, scalar)

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
        grid_diagonal=grid_diagonal_kernel,
        grid_matrix=grid_matrix_kernel,
        dense_strip=dense_strip_kernel,
    )
