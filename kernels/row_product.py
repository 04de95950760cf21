"""The product of the sparse matrix with a vector on CUDA, of its numbers in nine planes, one for each of a block.

Few threads share a row, each whole blocks, and neighbouring threads read neighbouring numbers of a plane: with a
thread for each number of a block an instruction read those of three blocks, now one of 32.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .conjugate_gradient import turning
from .reduction import adder, lane_adder

PLANES = 9
"""Numbers of a block."""
LANES = 4
"""Threads that share a row; three write a component each."""


@cache
def row_product_kernels(scalar: type) -> SimpleNamespace:
    """The kernels `spread` and `turn_and_multiply` in one precision."""
    add, add_lanes = adder(True), lane_adder(scalar)
    vec3 = wp.types.vector(3, scalar)
    mat33 = wp.types.matrix((3, 3), scalar)

    @wp.kernel(module="unique", enable_backward=False)
    def spread_kernel(
        first: int,
        end: int,
        slab: int,
        blocks: wp.array(dtype=mat33, ndim=2),
        planes: wp.array(dtype=scalar, ndim=2),
    ):
        """Copies the numbers of the blocks into their planes."""
        i = first + wp.tid()
        if i < end:
            block = blocks[0, i]
            for n in range(PLANES):
                planes[n, i] = block[n // 3, n % 3]

    @wp.func_native(f"""
    decltype(vectors.data[0] + vectors.data[0]) sum;
    for (int k = first; k < end; k += {2 * LANES}) {{
        #pragma unroll
        for (int n = 0; n < 2; ++n) {{  // both are asked for before the first is waited for
            const int block = min(k + {LANES} * n, end - 1);
            const decltype(+sum[0]) used = k + {LANES} * n < end;
            const decltype(sum) vector = used * vectors.data[columns.data[block]];
            const auto* number = planes.data + block;
            const size_t next = planes.shape[1];
            #pragma unroll
            for (int c = 0; c < 3; ++c)
                sum[c] += number[3 * c * next] * vector[0] + number[(3 * c + 1) * next] * vector[1]
                        + number[(3 * c + 2) * next] * vector[2];
        }}
    }}
    return sum;
    """)
    def part_of_row(
        planes: wp.array(dtype=scalar, ndim=2),
        columns: wp.array(dtype=wp.int32),
        vectors: wp.array(dtype=vec3),
        first: wp.int32,
        end: wp.int32,
    ) -> vec3:
        """What one of LANES threads adds to the product of a row, from its first block on."""
        ...

    @wp.kernel(module="unique", enable_backward=False)
    def turn_and_multiply_kernel(
        first: int,
        end: int,
        slab: int,
        row_start: wp.array(dtype=wp.int32),
        columns: wp.array(dtype=wp.int32),
        planes: wp.array(dtype=scalar, ndim=2),
        iteration: wp.array(dtype=wp.int32),
        r_dot_z: wp.array(dtype=wp.float64, ndim=2),
        z: wp.array(dtype=vec3),
        numbers_of_z: wp.array(dtype=scalar),
        p: wp.array(dtype=scalar),
        q: wp.array(dtype=scalar),
        p_dot_q: wp.array(dtype=wp.float64, ndim=2),
    ):
        """p = z + beta p and q = A p, which is A z + beta q, with p . q, in one launch; see `turning`."""
        item = first + wp.tid()
        i = item // LANES
        c = item % LANES
        j = iteration[0]
        along = vec3()
        if item < end:
            along = part_of_row(planes, columns, z, row_start[i] + c, row_start[i + 1])
        along = vec3(add_lanes(along[0], LANES), add_lanes(along[1], LANES), add_lanes(along[2], LANES))
        product = wp.float64(0.0)
        if item < end and c < 3:
            k = 3 * i + c
            own = wp.where(c == 0, along[0], wp.where(c == 1, along[1], along[2]))
            beta, bent = turning(r_dot_z, p_dot_q, j, 1)
            if j == 0:
                p[k] = numbers_of_z[k]
                q[k] = own
            elif not bent:
                p[k] = numbers_of_z[k] + scalar(beta) * p[k]
                q[k] = own + scalar(beta) * q[k]
            product = wp.float64(p[k]) * wp.float64(q[k])
        add(p_dot_q, j, 0, product)

    return SimpleNamespace(spread=spread_kernel, turn_and_multiply=turn_and_multiply_kernel)
