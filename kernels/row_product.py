"""The product of the sparse matrix with a vector on CUDA: nine threads share a row, one a number of its blocks.

Neighbouring threads read neighbouring numbers, so that a warp reads whole cache lines of the blocks of three rows.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .conjugate_gradient import turning
from .reduction import adder

WARP = 32
"""Threads of a warp."""
NUMBERS = 9
"""Numbers of a block, and threads that share it."""
ROWS = 3
"""Rows, or blocks, that a warp shares among its first 27 threads."""


def warps_over(size: int) -> int:
    """Threads for so many rows or blocks."""
    return -(-size // ROWS) * WARP


@cache
def row_product_kernels(scalar: type) -> SimpleNamespace:
    """The kernel `turn_and_multiply` in one precision."""
    add = adder(True)

    @wp.func_native("""
    decltype(+*numbers.data) sum = 0;
    const int column = entry % 3;
    #pragma unroll 4
    for (int k = first; k < end; ++k)
        sum += numbers.data[(size_t)9 * k + entry] * vector.data[3 * columns.data[k] + column];
    return sum + __shfl_down_sync(0xffffffffu, sum, 1) + __shfl_down_sync(0xffffffffu, sum, 2);
    """)
    def row_sum(
        numbers: wp.array(dtype=scalar),
        columns: wp.array(dtype=wp.int32),
        vector: wp.array(dtype=scalar),
        first: wp.int32,
        end: wp.int32,
        entry: wp.int32,
    ) -> scalar:
        """The product of a row of the matrix, at the threads of the first number of each of its three lines."""
        ...

    @wp.kernel(module="unique", enable_backward=False)
    def turn_and_multiply_kernel(
        first: int,
        end: int,
        slab: int,
        row_start: wp.array(dtype=wp.int32),
        columns: wp.array(dtype=wp.int32),
        numbers: wp.array(dtype=scalar),
        iteration: wp.array(dtype=wp.int32),
        r_dot_z: wp.array(dtype=wp.float64, ndim=2),
        z: wp.array(dtype=scalar),
        p: wp.array(dtype=scalar),
        q: wp.array(dtype=scalar),
        p_dot_q: wp.array(dtype=wp.float64, ndim=2),
    ):
        """p = z + beta p and q = A p, which is A z + beta q, with p . q, in one launch; see `turning`."""
        item = first + wp.tid()
        lane = item % WARP
        i = ROWS * (item // WARP) + lane // NUMBERS
        entry = lane % NUMBERS
        j = iteration[0]
        inside = lane < ROWS * NUMBERS and i < row_start.shape[0] - 1
        begin = wp.int32(0)
        stop = wp.int32(0)
        if inside:
            begin = row_start[i]
            stop = row_start[i + 1]
        along = row_sum(numbers, columns, z, begin, stop, entry)
        product = wp.float64(0.0)
        if inside and entry % 3 == 0:
            k = 3 * i + entry // 3
            beta, bent = turning(r_dot_z, p_dot_q, j, 1)
            if j == 0:
                p[k] = z[k]
                q[k] = along
            elif not bent:
                p[k] = z[k] + scalar(beta) * p[k]
                q[k] = along + scalar(beta) * q[k]
            product = wp.float64(p[k]) * wp.float64(q[k])
        add(p_dot_q, j, 0, product)

    return SimpleNamespace(turn_and_multiply=turn_and_multiply_kernel)
