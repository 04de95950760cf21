"""The sparse matrix of 3x3 blocks over the free nodes, and its product with a vector on CUDA."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .conjugate_gradient import turning
from .reduction import adder, lane_adder

ROW_LANES = 8
"""Threads that share a row of the product on CUDA, so that neighbours read neighbouring blocks."""


@cache
def sparse_kernels(scalar: type, cuda: bool) -> SimpleNamespace:
    """The kernels `turn_and_multiply` (for CUDA), `mirror` and `invert_diagonal` in one precision."""
    add, add_lanes = adder(cuda), lane_adder(scalar)
    lanes = wp.constant(ROW_LANES)
    vec3 = wp.types.vector(3, scalar)
    mat33 = wp.types.matrix((3, 3), scalar)

    @wp.kernel(module="unique", enable_backward=False)
    def turn_and_multiply_kernel(
        first: int,
        end: int,
        slab: int,
        row_start: wp.array(dtype=wp.int32),
        columns: wp.array(dtype=wp.int32),
        blocks: wp.array(dtype=mat33, ndim=2),
        iteration: wp.array(dtype=wp.int32),
        r_dot_z: wp.array(dtype=wp.float64, ndim=2),
        z: wp.array(dtype=vec3),
        p: wp.array(dtype=vec3),
        q: wp.array(dtype=vec3),
        p_dot_q: wp.array(dtype=wp.float64, ndim=2),
    ):
        """p = z + beta p and q = A p, which is A z + beta q, with p . q, in one launch for CUDA; see `turning`."""
        item = first + wp.tid()
        i = item // lanes
        j = iteration[0]
        product = wp.float64(0.0)
        total = vec3()
        if item < end:
            for k in range(row_start[i] + item % lanes, row_start[i + 1], lanes):
                total += blocks[0, k] * z[columns[k]]
        total = vec3(add_lanes(total[0], lanes), add_lanes(total[1], lanes), add_lanes(total[2], lanes))
        if item < end and item % lanes == 0:
            beta, bent = turning(r_dot_z, p_dot_q, j, 1)
            if j == 0:
                p[i] = z[i]
                q[i] = total
            elif not bent:
                p[i] = z[i] + scalar(beta) * p[i]
                q[i] = total + scalar(beta) * q[i]
            product = wp.float64(wp.dot(p[i], q[i]))
        add(p_dot_q, j, 0, product)

    @wp.kernel(module="unique", enable_backward=False)
    def invert_diagonal_kernel(
        first: int,
        end: int,
        slab: int,
        diagonal: wp.array(dtype=wp.int32),
        blocks: wp.array(dtype=mat33, ndim=2),
        factor: scalar,
        inverse: wp.array(dtype=mat33),
    ):
        """factor D^-1; each block is shifted by a millionth of its trace so that a flat one has an inverse."""
        i = first + wp.tid()
        if i < end:
            block = blocks[0, diagonal[i]]
            shift = scalar(1.0e-6) * wp.trace(block) + scalar(1.0e-30)
            inverse[i] = factor * wp.inverse(block + shift * wp.identity(n=3, dtype=scalar))

    @wp.kernel(module="unique", enable_backward=False)
    def mirror_kernel(
        first: int,
        end: int,
        slab: int,
        lower: wp.array(dtype=wp.int32),
        mirrored: wp.array(dtype=wp.int32),
        blocks: wp.array(dtype=mat33, ndim=2),
    ):
        """Sets the blocks below the diagonal to the transposed ones above it."""
        i = first + wp.tid()
        if i < end:
            blocks[0, lower[i]] = wp.transpose(blocks[0, mirrored[i]])

    return SimpleNamespace(
        mirror=mirror_kernel,
        turn_and_multiply=turn_and_multiply_kernel,
        invert_diagonal=invert_diagonal_kernel,
    )


@cache
def half_kernels(scalar: type) -> wp.Kernel:
    """The kernel that copies some blocks, in one precision."""
    mat33 = wp.types.matrix((3, 3), scalar)

    @wp.kernel(module="unique", enable_backward=False)
    def take_kernel(
        first: int,
        end: int,
        slab: int,
        taken: wp.array(dtype=wp.int32),
        blocks: wp.array(dtype=mat33, ndim=2),
        half: wp.array(dtype=mat33),
    ):
        i = first + wp.tid()
        if i < end:
            half[i] = blocks[0, taken[i]]

    return take_kernel
