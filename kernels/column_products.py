"""Products of matrices with the columns of a field; see `columns`.

On CUDA an item sums in variables. On the CPU it sums in memory: a vector that a loop carries along in a variable
is taken apart and put together at every turn, which costs more than the sum.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from .columns import SLOTS
from .multilevel import vec8i


@cache
def column_product_kernels(scalar: type, cuda: bool, width: int) -> SimpleNamespace:
    """The kernels `multiply`, `multiply_dense`, `restrict` and `prolong` in one precision."""
    column: Any = wp.types.vector(width, scalar)
    double: Any = wp.types.vector(width, wp.float64)
    mat33 = wp.types.matrix((3, 3), scalar)
    vec8 = wp.types.vector(8, scalar)

    @wp.func
    def set_triple(field: wp.array2d(dtype=column), i: int, at: int, a: column, b: column, c: column):
        """Writes the three components of a group at a node."""
        field[i, at] = a
        field[i, at + 1] = b
        field[i, at + 2] = c

    @wp.func
    def product(p: wp.array2d(dtype=column), q: wp.array2d(dtype=column), i: int, at: int):
        """Scalar products of the columns of a group at a node."""
        return double(
            wp.cw_mul(p[i, at], q[i, at])
            + wp.cw_mul(p[i, at + 1], q[i, at + 1])
            + wp.cw_mul(p[i, at + 2], q[i, at + 2])
        )

    @wp.kernel(module="unique", enable_backward=False)
    def multiply_kernel(
        first: int,
        end: int,
        slab: int,
        groups: int,
        stretch: int,
        row_start: wp.array(dtype=wp.int32),
        columns: wp.array(dtype=wp.int32),
        blocks: wp.array(dtype=mat33, ndim=2),
        p: wp.array(dtype=column, ndim=2),
        q: wp.array(dtype=column, ndim=2),
        p_dot_q: wp.array(dtype=double, ndim=2),
    ):
        """q = A p, and p . q of each column."""
        item = first + wp.tid()
        if item < end:
            group = item % groups
            at = 3 * group
            start = item // groups * stretch
            dot = double()
            for i in range(start, wp.min(start + stretch, q.shape[0])):
                a = column()
                b = column()
                c = column()
                set_triple(q, i, at, a, b, c)
                for k in range(row_start[i], row_start[i + 1]):
                    block = blocks[0, k]
                    j = columns[k]
                    x = p[j, at]
                    y = p[j, at + 1]
                    z = p[j, at + 2]
                    by_x = block[0, 0] * x + block[0, 1] * y + block[0, 2] * z
                    by_y = block[1, 0] * x + block[1, 1] * y + block[1, 2] * z
                    by_z = block[2, 0] * x + block[2, 1] * y + block[2, 2] * z
                    if wp.static(cuda):
                        a += by_x
                        b += by_y
                        c += by_z
                    else:
                        set_triple(q, i, at, q[i, at] + by_x, q[i, at + 1] + by_y, q[i, at + 2] + by_z)
                if wp.static(cuda):
                    set_triple(q, i, at, a, b, c)
                    dot += product(p, q, i, at)
                else:
                    p_dot_q[slab, group] = p_dot_q[slab, group] + product(p, q, i, at)
            if wp.static(cuda):
                wp.atomic_add(p_dot_q, item // groups % wp.static(SLOTS), group, dot)

    @wp.kernel(module="unique", enable_backward=False)
    def multiply_dense_kernel(
        first: int,
        end: int,
        slab: int,
        groups: int,
        chunk: int,
        blocks: wp.array(dtype=mat33, ndim=2),
        p: wp.array(dtype=column, ndim=2),
        q: wp.array(dtype=column, ndim=2),
    ):
        """Adds a chunk of blocks of A p to q; on the CPU a chunk is a whole row."""
        item = first + wp.tid()
        if item < end:
            at = 3 * (item % groups)
            i = item // groups % q.shape[0]
            start = item // groups // q.shape[0] * chunk
            a = column()
            b = column()
            c = column()
            for j in range(start, wp.min(start + chunk, p.shape[0])):
                block = blocks[i, j]
                x = p[j, at]
                y = p[j, at + 1]
                z = p[j, at + 2]
                by_x = block[0, 0] * x + block[0, 1] * y + block[0, 2] * z
                by_y = block[1, 0] * x + block[1, 1] * y + block[1, 2] * z
                by_z = block[2, 0] * x + block[2, 1] * y + block[2, 2] * z
                if wp.static(cuda):
                    a += by_x
                    b += by_y
                    c += by_z
                else:
                    set_triple(q, i, at, q[i, at] + by_x, q[i, at + 1] + by_y, q[i, at + 2] + by_z)
            if wp.static(cuda):
                wp.atomic_add(q, i, at, a)
                wp.atomic_add(q, i, at + 1, b)
                wp.atomic_add(q, i, at + 2, c)

    @wp.kernel(module="unique", enable_backward=False)
    def restrict_kernel(
        first: int,
        end: int,
        slab: int,
        groups: int,
        stretch: int,
        row_start: wp.array(dtype=wp.int32),
        point: wp.array(dtype=wp.int32),
        weight: wp.array(dtype=scalar),
        residual: wp.array(dtype=column, ndim=2),
        coarse_residual: wp.array(dtype=column, ndim=2),
    ):
        """P^T r: every grid vertex gathers the residual of the points it reaches."""
        item = first + wp.tid()
        if item < end:
            group = item % groups
            at = 3 * group
            start = item // groups * stretch
            for v in range(start, wp.min(start + stretch, coarse_residual.shape[0])):
                a = column()
                b = column()
                c = column()
                set_triple(coarse_residual, v, at, a, b, c)
                for k in range(row_start[v], row_start[v + 1]):
                    w = weight[k]
                    i = point[k]
                    if wp.static(cuda):
                        a += w * residual[i, at]
                        b += w * residual[i, at + 1]
                        c += w * residual[i, at + 2]
                    else:
                        set_triple(
                            coarse_residual,
                            v,
                            at,
                            coarse_residual[v, at] + w * residual[i, at],
                            coarse_residual[v, at + 1] + w * residual[i, at + 1],
                            coarse_residual[v, at + 2] + w * residual[i, at + 2],
                        )
                if wp.static(cuda):
                    set_triple(coarse_residual, v, at, a, b, c)

    @wp.kernel(module="unique", enable_backward=False)
    def prolong_kernel(
        first: int,
        end: int,
        slab: int,
        groups: int,
        stretch: int,
        inverse_diagonal: wp.array(dtype=mat33),
        vertex: wp.array(dtype=vec8i),
        weight: wp.array(dtype=vec8),
        coarse: wp.array(dtype=column, ndim=2),
        residual: wp.array(dtype=column, ndim=2),
        correction: wp.array(dtype=column, ndim=2),
        r_dot_z: wp.array(dtype=double, ndim=2),
    ):
        """z = D^-1 r + P z_coarse, and r . z of each column."""
        item = first + wp.tid()
        if item < end:
            group = item % groups
            at = 3 * group
            start = item // groups * stretch
            dot = double()
            for i in range(start, wp.min(start + stretch, residual.shape[0])):
                inverse = inverse_diagonal[i]
                x = residual[i, at]
                y = residual[i, at + 1]
                z = residual[i, at + 2]
                a = inverse[0, 0] * x + inverse[0, 1] * y + inverse[0, 2] * z
                b = inverse[1, 0] * x + inverse[1, 1] * y + inverse[1, 2] * z
                c = inverse[2, 0] * x + inverse[2, 1] * y + inverse[2, 2] * z
                vertices = vertex[i]
                weights = weight[i]
                for k in range(8):
                    v = vertices[k]
                    w = weights[k]
                    a += w * coarse[v, at]
                    b += w * coarse[v, at + 1]
                    c += w * coarse[v, at + 2]
                set_triple(correction, i, at, a, b, c)
                if wp.static(cuda):
                    dot += product(residual, correction, i, at)
                else:
                    r_dot_z[slab, group] = r_dot_z[slab, group] + product(residual, correction, i, at)
            if wp.static(cuda):
                wp.atomic_add(r_dot_z, item // groups % wp.static(SLOTS), group, dot)

    return SimpleNamespace(
        multiply=multiply_kernel,
        multiply_dense=multiply_dense_kernel,
        restrict=restrict_kernel,
        prolong=prolong_kernel,
    )
