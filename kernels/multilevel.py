"""Matrices of the preconditioner's grids."""

from functools import cache
from types import SimpleNamespace

import warp as wp

vec8i = wp.types.vector(8, wp.int32)
KEPT = 0.999
"""What a symmetric positive matrix with ones on its diagonal keeps beside them in 16 bits. Rounding there
changes its eigenvalues, by 8e-4 where it has 1700 rows: so it stays positive also where a few nodes leave grid
vertices idle."""


@cache
def multilevel_kernels(scalar: type) -> SimpleNamespace:
    """The kernels that add up their matrices, in one precision."""
    vec8 = wp.types.vector(8, scalar)
    mat33 = wp.types.matrix((3, 3), scalar)
    by_corner = wp.types.matrix((24, 3), scalar)

    @wp.kernel(module="unique", enable_backward=False)
    def grid_diagonal_kernel(
        first: int,
        end: int,
        slab: int,
        row_start: wp.array(dtype=wp.int32),
        columns: wp.array(dtype=wp.int32),
        blocks: wp.array(dtype=mat33, ndim=2),
        vertex: wp.array(dtype=vec8i),
        weight: wp.array(dtype=vec8),
        diagonal: wp.array(dtype=mat33, ndim=2),
    ):
        """Adds what the matrix row of one node, from its diagonal on, gives to the diagonal blocks of P^T H P."""
        i = first + wp.tid()
        if i < end:
            own = vertex[i]
            w = weight[i]
            for n in range(row_start[i], row_start[i + 1]):
                c = columns[n]
                if c >= i:
                    other = vertex[c]
                    v = weight[c]
                    block = blocks[0, n]
                    if c > i:
                        block += wp.transpose(block)
                    for k in range(8):
                        for m in range(8):
                            if own[k] == other[m]:
                                wp.atomic_add(diagonal, slab, own[k], (w[k] * v[m]) * block)

    @wp.func
    def add_pair(matrix: wp.array3d(dtype=wp.float64), slab: int, u: int, v: int, block: mat33):
        """Adds a block and its image to those of two vertices, where they are not below the diagonal."""
        row = 3 * wp.min(u, v)
        column = 3 * wp.max(u, v)
        if u > v:
            block = wp.transpose(block)
        elif u == v:
            block += wp.transpose(block)
        for a in range(3):
            for b in range(3):
                wp.atomic_add(matrix, slab, row + a, column + b, wp.float64(block[a, b]))

    @wp.kernel(module="unique", enable_backward=False)
    def grid_matrix_kernel(
        first: int,
        end: int,
        slab: int,
        row_start: wp.array(dtype=wp.int32),
        columns: wp.array(dtype=wp.int32),
        blocks: wp.array(dtype=mat33, ndim=2),
        vertex: wp.array(dtype=vec8i),
        weight: wp.array(dtype=vec8),
        matrix: wp.array(dtype=wp.float64, ndim=3),
    ):
        """Adds what the matrix row of one node gives to P^T H P, dense: its blocks on and above the diagonal.

        Most neighbours are in the same cell: what they give is added up before it is spread over the cell.
        """
        i = first + wp.tid()
        if i < end:
            own = vertex[i]
            w = weight[i]
            same = by_corner()
            corners = wp.int32(8)  # a loop to it is not unrolled, which would take seconds to compile
            for n in range(row_start[i], row_start[i + 1]):
                c = columns[n]
                if c >= i:
                    other = vertex[c]
                    v = weight[c]
                    block = blocks[0, n]
                    if c == i:
                        block *= scalar(0.5)  # its image is added, too
                    if other == own:
                        for m in range(8):
                            for a in range(3):
                                for b in range(3):
                                    same[3 * m + a, b] += v[m] * block[a, b]
                    else:
                        for k in range(corners):
                            for m in range(8):
                                add_pair(matrix, slab, own[k], other[m], (w[k] * v[m]) * block)
            for m in range(8):
                block = mat33()
                for a in range(3):
                    for b in range(3):
                        block[a, b] = same[3 * m + a, b]
                for k in range(corners):
                    add_pair(matrix, slab, own[k], own[m], w[k] * block)

    return SimpleNamespace(
        grid_diagonal=grid_diagonal_kernel,
        grid_matrix=grid_matrix_kernel,
    )
