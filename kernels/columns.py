"""Fields of several columns: vectors that are solved for at once, so that every block is read once for all.

A field has shape (nodes, 3 groups) of `width` columns each: component d of group g is at [node, 3 g + d]. An
item is a stretch of nodes in one group. Scalar products are kept by slot and group.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

SLOTS = 64
"""Sums on CUDA that share the adding of one scalar product."""


WIDTHS = {False: (8, 16, 32), True: (4,)}
"""Columns of a group on the CPU, one to four vector registers, and on CUDA, what one thread reads at once."""


def width(count: int, cuda: bool) -> int:
    """Columns of a group where there are so many: the least that holds all, for blocks are read once a group."""
    return next((width for width in WIDTHS[cuda] if count <= width), WIDTHS[cuda][-1])


@cache
def column_kernels(scalar: type, width: int) -> SimpleNamespace:
    """The kernels `write` and `read` in one precision."""
    size = wp.constant(width)
    column: Any = wp.types.vector(width, scalar)

    @wp.kernel(module="unique", enable_backward=False)
    def write_kernel(
        first: int,
        end: int,
        slab: int,
        factor: wp.array(dtype=wp.float64),
        values: wp.array(dtype=scalar, ndim=3),
        field: wp.array(dtype=column, ndim=2),
    ):
        """Sets a field to columns of shape (columns, nodes, 3), each times its factor; those to spare are 0."""
        i = first + wp.tid()
        if i < end:
            for g in range(field.shape[1] // 3):
                for d in range(3):
                    value = column()
                    for c in range(size):
                        n = size * g + c
                        if n < values.shape[0]:
                            value[c] = scalar(factor[n]) * values[n, i, d]
                    field[i, 3 * g + d] = value

    @wp.kernel(module="unique", enable_backward=False)
    def read_kernel(
        first: int,
        end: int,
        slab: int,
        factor: wp.array(dtype=wp.float64),
        field: wp.array(dtype=column, ndim=2),
        values: wp.array(dtype=scalar, ndim=3),
    ):
        """The columns of a field, each times a factor."""
        i = first + wp.tid()
        if i < end:
            for g in range(field.shape[1] // 3):
                for d in range(3):
                    value = field[i, 3 * g + d]
                    for c in range(size):
                        n = size * g + c
                        if n < values.shape[0]:
                            values[n, i, d] = scalar(factor[n]) * value[c]

    return SimpleNamespace(write=write_kernel, read=read_kernel)
