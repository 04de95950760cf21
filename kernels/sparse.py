"""The sparse matrix of 3x3 blocks over the free nodes, and its product with a vector.

On the CPU the product is a loop in C++ over the rows of a range and reads half of the blocks: a Warp item reads
all arguments of its kernel again, which costs more than a row. On CUDA few threads share a row, each whole blocks,
and the nine numbers of the blocks lie in nine planes, so that neighbouring threads read neighbouring numbers."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .arguments import Ints, Items, array_types
from .conjugate_gradient import KEEP_PRODUCT, Dots, find_beta
from .native import FOUR_TYPES, native_kernel, real
from .vectors import add_sum, component, lane_reducer

PLANES = 9
"""Numbers of a block."""
PRODUCT_LANES = 4
"""CUDA threads that share a row; three write a component each."""

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
            // the mirror image of the block, for a row of the same range that is yet to come
            if (j > i && j < end) below[j] += l * by_x + n * by_y + o * by_z;
        }
        const four sum = below[i];
        below[i] = four{0, 0, 0, 0};
        y[3 * i] = sum[0] + (a[0] + a[1] + a[2]);
        y[3 * i + 1] = sum[1] + (b[0] + b[1] + b[2]);
        y[3 * i + 2] = sum[2] + (c[0] + c[1] + c[2]);
        product += own[0] * y[3 * i] + own[1] * y[3 * i + 1] + own[2] * y[3 * i + 2];
    }
"""


@cache
def diagonal_inverter(scalar: type) -> wp.Kernel:
    """The kernel of the inverse diagonal for both devices, in one precision."""
    _, _, Blocks = array_types(scalar)

    @wp.kernel(module=f"sparse_{scalar.__name__}", enable_backward=False)
    def invert_diagonal(items: Items, diagonal: Ints, blocks: Blocks, factor: scalar, inverse: Blocks):
        """factor D^-1; each block is shifted by a millionth of its trace so that a flat one has an inverse."""
        i = items.first + wp.tid()
        if i < items.end:
            block = blocks[diagonal[i]]
            shift = scalar(1.0e-6) * wp.trace(block) + scalar(1.0e-30)
            inverse[i] = factor * wp.inverse(block + shift * wp.identity(n=3, dtype=scalar))

    return invert_diagonal


@cache
def cpu_product_kernel(scalar: type) -> wp.Kernel:
    """The kernel of q = A p on the CPU, in one precision."""
    _, Vectors, Blocks = array_types(scalar)
    Fours = wp.array[wp.types.vector(4, scalar)]

    @native_kernel(f"cpu_product_{scalar.__name__}", real(scalar) + FOUR_TYPES + MULTIPLY + KEEP_PRODUCT)
    def multiply(
        items: Items,
        row_start: Ints,
        columns: Ints,
        blocks: Blocks,
        p: Vectors,
        q: Vectors,
        dots: Dots,
        carried: Fours,
    ):
        """q = A p, and the part of p . q that this range holds, kept by iteration.

        A block right of the diagonal, whose column is of the same range, stands for its mirror image, too.
        `carried` is zero before and after, shape (rows,), and the blocks have one to spare.
        """

    return multiply


@cache
def cuda_product_kernels(scalar: type) -> SimpleNamespace:
    """The kernels `split_planes` and `update_search_and_multiply` in one precision."""
    add_lanes = lane_reducer(scalar)
    vec3, Planes = wp.types.vector(3, scalar), wp.array2d[scalar]
    Numbers, Vectors, Blocks = array_types(scalar)
    module = f"cuda_product_{scalar.__name__}"

    @wp.kernel(module=module, enable_backward=False)
    def split_planes(items: Items, blocks: Blocks, planes: Planes):
        """Copies the numbers of the blocks into their planes."""
        i = items.first + wp.tid()
        if i < items.end:
            block = blocks[i]
            for n in range(PLANES):
                planes[n, i] = block[n // 3, n % 3]

    @wp.func_native(f"""
    decltype(vectors.data[0] + vectors.data[0]) sum;
    for (int k = first; k < end; k += {2 * PRODUCT_LANES}) {{
        #pragma unroll
        for (int n = 0; n < 2; ++n) {{  // both are asked for before the first is waited for
            const int block = min(k + {PRODUCT_LANES} * n, end - 1);  // past the end the last one, times zero
            const decltype(+sum[0]) used = k + {PRODUCT_LANES} * n < end;
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
    def part_of_row(planes: Planes, columns: Ints, vectors: Vectors, first: int, end: int) -> vec3:
        """Contribution of one of PRODUCT_LANES threads to the product of a row, from its first block on."""
        ...

    @wp.kernel(module=module, enable_backward=False)
    def update_search_and_multiply(
        items: Items,
        row_start: Ints,
        columns: Ints,
        planes: Planes,
        r_dot_z: Dots,
        p_dot_q: Dots,
        z: Vectors,
        numbers_of_z: Numbers,
        p: Numbers,
        q: Numbers,
    ):
        """p = z + beta p and q = A p, which is A z + beta q, with p . q, in one launch; see `find_beta`."""
        item = items.first + wp.tid()
        i = item // PRODUCT_LANES
        c = item % PRODUCT_LANES
        j = r_dot_z.iteration[0]
        along = vec3()
        if item < items.end:
            along = part_of_row(planes, columns, z, row_start[i] + c, row_start[i + 1])
        along = vec3(
            add_lanes(along[0], PRODUCT_LANES),
            add_lanes(along[1], PRODUCT_LANES),
            add_lanes(along[2], PRODUCT_LANES),
        )
        product = wp.float64(0.0)
        if item < items.end and c < 3:
            k = 3 * i + c
            own = component(along, c)
            beta = find_beta(r_dot_z, p_dot_q)
            if j == 0:
                p[k] = numbers_of_z[k]
                q[k] = own
            elif not wp.isnan(beta):  # else p stays, for the host to go along it
                p[k] = numbers_of_z[k] + scalar(beta) * p[k]
                q[k] = own + scalar(beta) * q[k]
            product = wp.float64(p[k]) * wp.float64(q[k])
        if item == 0:
            p_dot_q.iteration[0] = j  # which no thread reads here
        add_sum(p_dot_q.products, j, 0, product)

    return SimpleNamespace(split_planes=split_planes, update_search_and_multiply=update_search_and_multiply)
