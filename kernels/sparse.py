"""The sparse matrix of 3x3 blocks over the free nodes; for products see `row_loops` and `row_product`."""

from functools import cache
from types import SimpleNamespace

import warp as wp


@cache
def sparse_kernels(scalar: type) -> SimpleNamespace:
    """The kernels `mirror`, for the CPU, and `invert_diagonal`, in one precision."""
    mat33 = wp.types.matrix((3, 3), scalar)

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
