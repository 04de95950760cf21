"""Products of the linear solver on the CPU, each a loop in C++ over the rows of a range.

A Warp item on the CPU reads all arguments of its kernel anew, which costs more than what it does here; and rows of
three numbers become vector instructions only where they are read as four. A launch has one item for each range.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .multilevel import vec8i
from .reduction import adder

TYPES = """
    typedef REAL real;
    typedef real four __attribute__((vector_size(4 * sizeof(real))));
    typedef real loose __attribute__((vector_size(4 * sizeof(real)), aligned(sizeof(real))));
    const auto three = [](const real* x) { return four{x[0], x[1], x[2], 0}; };
"""
"""`three` reads a vector of three numbers, `loose` with the number after it, which counts for nothing."""

MULTIPLY = """
    const wp::int32* __restrict__ column = columns.data;
    const real* __restrict__ block = (const real*)blocks.data;
    const real* __restrict__ x = (const real*)p.data;
    real* __restrict__ y = (real*)q.data;
    four* __restrict__ below = (four*)carried.data;
    double product = 0.0;
    wp::int32 k = row_start.data[first];
    for (wp::int32 i = first; i < end; ++i) {
        const wp::int32 last = row_start.data[i + 1];
        const four own = three(x + 3 * i);
        const four by_x = {own[0], own[0], own[0], own[0]};
        const four by_y = {own[1], own[1], own[1], own[1]};
        const four by_z = {own[2], own[2], own[2], own[2]};
        four a = {0, 0, 0, 0}, b = a, c = a;
        for (; k < last; ++k) {
            const wp::int32 j = column[k];
            const four v = three(x + 3 * j);
            const real* m = block + 9 * k;
            const four l = *(const loose*)m, n = *(const loose*)(m + 3), o = *(const loose*)(m + 6);
            a += l * v;
            b += n * v;
            c += o * v;
            if (j > i && j < end) below[j] += l * by_x + n * by_y + o * by_z;
        }
        const four sum = below[i];
        below[i] = four{0, 0, 0, 0};
        y[3 * i] = sum[0] + (a[0] + a[1] + a[2]);
        y[3 * i + 1] = sum[1] + (b[0] + b[1] + b[2]);
        y[3 * i + 2] = sum[2] + (c[0] + c[1] + c[2]);
        product += own[0] * y[3 * i] + own[1] * y[3 * i + 1] + own[2] * y[3 * i + 2];
    }
    return product;
"""

RESTRICT = """
    const real* __restrict__ x = (const real*)residual.data;
    const wp::int32* __restrict__ at = point.data;
    const real* __restrict__ w = weight.data;
    real* __restrict__ y = (real*)coarse_residual.data;
    wp::int32 k = row_start.data[first];
    for (wp::int32 v = first; v < end; ++v) {
        const wp::int32 last = row_start.data[v + 1];
        four even = {0, 0, 0, 0}, odd = even;
        for (; k + 1 < last; k += 2) {
            even += w[k] * three(x + 3 * at[k]);
            odd += w[k + 1] * three(x + 3 * at[k + 1]);
        }
        if (k < last) even += w[k] * three(x + 3 * at[k]);
        k = last;
        even += odd;
        y[3 * v] = even[0];
        y[3 * v + 1] = even[1];
        y[3 * v + 2] = even[2];
    }
"""

PROLONG = """
    const real* __restrict__ diagonal = (const real*)inverse_diagonal.data;
    const wp::int32* __restrict__ at = (const wp::int32*)vertex.data;
    const real* __restrict__ w = (const real*)weight.data;
    const real* __restrict__ from = (const real*)coarse.data;
    const real* __restrict__ x = (const real*)residual.data;
    real* __restrict__ y = (real*)correction.data;
    double product = 0.0;
    for (wp::int32 i = first; i < end; ++i) {
        const real* m = diagonal + 9 * i;
        const real* r = x + 3 * i;
        four z = r[0] * three(m) + r[1] * three(m + 3) + r[2] * three(m + 6);
        for (wp::int32 k = 8 * i; k < 8 * i + 8; ++k) z += w[k] * *(const loose*)(from + 3 * at[k]);
        y[3 * i] = z[0];
        y[3 * i + 1] = z[1];
        y[3 * i + 2] = z[2];
        product += r[0] * z[0] + r[1] * z[1] + r[2] * z[2];
    }
    return product;
"""

STRIP = 16
"""Rows of the dense product that are added up together."""
WHOLE = 32000
"""What stands for 1 in 16 bits, with room for what rounding adds."""

DENSE = """
    typedef wp::int16 shorts __attribute__((ext_vector_type(8), aligned(2)));
    typedef real eight __attribute__((ext_vector_type(8)));
    const shorts* number = (const shorts*)inverse.data + 2 * (long)size * first;
    const real* s = scale.data;
    const real* x = residual.data;
    const auto at = [&](long k) { return __builtin_convertvector(number[k], eight); };
    for (wp::int32 b = first; b < end; ++b, number += 2 * (long)size) {
        eight low[2] = {0, 0}, high[2] = {0, 0};
        for (wp::int32 k = 0; k < size; k += 2) {
            for (int odd = 0; odd < 2; ++odd) {
                const real v = s[k + odd] * x[k + odd];
                low[odd] += at(2 * (k + odd)) * v;
                high[odd] += at(2 * (k + odd) + 1) * v;
            }
        }
        low[0] += low[1];
        high[0] += high[1];
        for (int l = 0; l < 8; ++l) {
            solution.data[16 * b + l] = s[16 * b + l] * low[0][l];
            solution.data[16 * b + 8 + l] = s[16 * b + 8 + l] * high[0][l];
        }
    }
"""


@cache
def row_loops(scalar: type) -> SimpleNamespace:
    """The kernels `multiply`, `restrict`, `prolong` and `dense`, in one precision."""
    add = adder(False)
    vec3, vec4, vec8 = (wp.types.vector(size, scalar) for size in (3, 4, 8))
    mat33 = wp.types.matrix((3, 3), scalar)
    types = TYPES.replace("REAL", "float" if scalar is wp.float32 else "double")

    @wp.func_native(types + MULTIPLY)
    def multiply_rows(
        first: int,
        end: int,
        row_start: wp.array(dtype=wp.int32),
        columns: wp.array(dtype=wp.int32),
        blocks: wp.array(dtype=mat33),
        p: wp.array(dtype=vec3),
        q: wp.array(dtype=vec3),
        carried: wp.array(dtype=vec4),
    ) -> wp.float64: ...

    @wp.func_native(types + RESTRICT)
    def restrict_rows(
        first: int,
        end: int,
        row_start: wp.array(dtype=wp.int32),
        point: wp.array(dtype=wp.int32),
        weight: wp.array(dtype=scalar),
        residual: wp.array(dtype=vec3),
        coarse_residual: wp.array(dtype=vec3),
    ): ...

    @wp.func_native(types + PROLONG)
    def prolong_rows(
        first: int,
        end: int,
        inverse_diagonal: wp.array(dtype=mat33),
        vertex: wp.array(dtype=vec8i),
        weight: wp.array(dtype=vec8),
        coarse: wp.array(dtype=vec3),
        residual: wp.array(dtype=vec3),
        correction: wp.array(dtype=vec3),
    ) -> wp.float64: ...

    @wp.func_native(types + DENSE)
    def dense_rows(
        first: int,
        end: int,
        size: int,
        inverse: wp.array(dtype=wp.int16),
        scale: wp.array(dtype=scalar),
        residual: wp.array(dtype=scalar),
        solution: wp.array(dtype=scalar),
    ): ...

    @wp.kernel(module="unique", enable_backward=False)
    def multiply_kernel(
        first: int,
        end: int,
        slab: int,
        row_start: wp.array(dtype=wp.int32),
        columns: wp.array(dtype=wp.int32),
        blocks: wp.array(dtype=mat33),
        iteration: wp.array(dtype=wp.int32),
        p: wp.array(dtype=vec3),
        q: wp.array(dtype=vec3),
        p_dot_q: wp.array(dtype=wp.float64, ndim=2),
        carried: wp.array(dtype=vec4),
    ):
        """q = A p, and the part of p . q that this range holds, kept by iteration; see `HalfRows`.

        A block right of the diagonal, whose column is of the same range, stands for its mirror image, too.
        `carried` is zero before and after, shape (rows,), and the blocks have one to spare.
        """
        value = multiply_rows(first, end, row_start, columns, blocks, p, q, carried)
        add(p_dot_q, iteration[0], 8 * slab, value)

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
        restrict_rows(first, end, row_start, point, weight, residual, coarse_residual)

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
        """z = D^-1 r + P z_coarse, and this range's part of r . z, kept by iteration; `coarse` has one more."""
        value = prolong_rows(first, end, inverse_diagonal, vertex, weight, coarse, residual, correction)
        add(products, iteration[0], 8 * slab, value)

    @wp.kernel(module="unique", enable_backward=False)
    def dense_kernel(
        first: int,
        end: int,
        slab: int,
        size: int,
        inverse: wp.array(dtype=wp.int16),
        scale: wp.array(dtype=scalar),
        residual: wp.array(dtype=scalar),
        solution: wp.array(dtype=scalar),
    ):
        """S A S r of strips, A in parts of `WHOLE`: of each strip column after column; `size` is even."""
        dense_rows(first, end, size, inverse, scale, residual, solution)

    return SimpleNamespace(
        multiply=multiply_kernel, restrict=restrict_kernel, prolong=prolong_kernel, dense=dense_kernel
    )
