"""Builds the coarse matrix P^T H P of the two-level preconditioner."""

from functools import cache
from types import SimpleNamespace

import warp as wp


@cache
def two_level_kernels(scalar: type) -> SimpleNamespace:
    """The kernel `coarse_matrix` in one precision; the matrix itself is in double precision."""
    vec4 = wp.types.vector(4, scalar)
    mat33 = wp.types.matrix((3, 3), scalar)

    @wp.kernel(module="unique", enable_backward=False)
    def coarse_matrix_kernel(
        row_start: wp.array(dtype=wp.int32),
        columns: wp.array(dtype=wp.int32),
        blocks: wp.array(dtype=mat33, ndim=2),
        aggregate: wp.array(dtype=wp.int32),
        mode: wp.array(dtype=vec4),
        coarse: wp.array(dtype=wp.float64, ndim=2),
    ):
        """Adds the row of one node: mode k of its aggregate against mode l of each neighbour's."""
        i = wp.tid()
        row = 12 * aggregate[i]
        m = mode[i]
        for n in range(row_start[i], row_start[i + 1]):
            j = columns[n]
            column = 12 * aggregate[j]
            other = mode[j]
            block = blocks[0, n]
            for k in range(4):
                for l in range(4):
                    weight = m[k] * other[l]
                    for a in range(3):
                        for b in range(3):
                            wp.atomic_add(
                                coarse, row + 3 * k + a, column + 3 * l + b, wp.float64(weight * block[a, b])
                            )

    return SimpleNamespace(coarse_matrix=coarse_matrix_kernel)
