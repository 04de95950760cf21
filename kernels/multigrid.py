"""The grids of the preconditioner: their matrices, restriction, the dense solve on the coarsest, prolongation.

On the CPU each grid has a launch down and a launch up, loops in C++ as in `sparse`. On CUDA, where a launch costs
more than most of its work, every grid interpolates directly to the nodes, so that three launches apply all of
them. They read the residual with four numbers a node. Weights and the dense inverse have 16 bits there: they shape
a preconditioner, and nothing of the solution."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .arguments import Ints, Items, array_types
from .conjugate_gradient import KEEP_PRODUCT, Dots
from .native import FOUR_TYPES, native_kernel, real
from .node_groups import MEMBERS, groups_type
from .vectors import add_sum, component, lane_reducer

vec8i = wp.types.vector(8, wp.int32)
Cells = wp.array[vec8i]
Halves, HalfRows = wp.array[wp.float16], wp.array2d[wp.float16]
Shorts = wp.array[wp.int16]
Singles = wp.array[wp.float32]
CORNERS = 8
"""Corners of a cell."""
DAMPING = 0.999
"""Factor of the off-diagonal numbers of a symmetric positive matrix with unit diagonal in 16 bits. Rounding there
changes its eigenvalues, by 8e-4 where it has 1700 rows: so it stays positive also where a few nodes leave grid
vertices idle."""


@cache
def grid_matrix_kernels(scalar: type, lanes: int) -> SimpleNamespace:
    """The kernels that add up their matrices, in one precision; `lanes` items share a node's diagonal blocks."""
    mat33 = wp.types.matrix((3, 3), scalar)
    _, _, Blocks = array_types(scalar)
    Weights = wp.array[wp.types.vector(8, scalar)]
    by_corner = wp.types.matrix((24, 3), scalar)
    module = f"grid_matrices_{scalar.__name__}_{lanes}"

    @wp.kernel(module=module, enable_backward=False)
    def grid_diagonal(
        items: Items,
        row_start: Ints,
        columns: Ints,
        blocks: Blocks,
        vertex: Cells,
        weight: Weights,
        diagonal: wp.array2d[mat33],
    ):
        """Adds what the matrix row of one node, from its diagonal on, gives to the diagonal blocks of P^T H P.

        With CORNERS lanes each has a corner, and adds up before it adds to the grid: half a million atomics on
        the few vertices of a coarse grid took 0.9 ms.
        """
        item = items.first + wp.tid()
        if item < items.end:
            i = item // lanes
            own = vertex[i]
            w = weight[i]
            total = mat33()
            for n in range(row_start[i], row_start[i + 1]):
                c = columns[n]
                if c >= i:
                    other = vertex[c]
                    v = weight[c]
                    block = blocks[n]
                    if c > i:
                        block += wp.transpose(block)
                    for k in range(item % lanes, 8, lanes):
                        for m in range(8):
                            if own[k] == other[m]:
                                if wp.static(lanes == CORNERS):
                                    total += v[m] * block
                                else:
                                    wp.atomic_add(diagonal, items.slab, own[k], (w[k] * v[m]) * block)
            if wp.static(lanes == CORNERS):
                wp.atomic_add(diagonal, items.slab, own[item % lanes], w[item % lanes] * total)

    @wp.func
    def add_pair(matrix: wp.array3d[wp.float64], slab: int, u: int, v: int, block: mat33):
        """Adds a block and its image to those of two vertices, where they are not below the diagonal."""
        row = 3 * wp.min(u, v)
        column = 3 * wp.max(u, v)
        if u > v:
            block = wp.transpose(block)
        elif u == v:
            block += wp.transpose(block)
        for a in range(3):  # in double precision: thousands of nodes add to a vertex of the coarsest grid
            for b in range(3):
                wp.atomic_add(matrix, slab, row + a, column + b, wp.float64(block[a, b]))

    @wp.kernel(module=module, enable_backward=False)
    def grid_matrix(
        items: Items,
        row_start: Ints,
        columns: Ints,
        blocks: Blocks,
        vertex: Cells,
        weight: Weights,
        matrix: wp.array3d[wp.float64],
    ):
        """Adds what the matrix row of one node gives to P^T H P, dense: its blocks on and above the diagonal.

        Most neighbours are in the same cell: what they give is added up before it is spread over the cell.
        """
        i = items.first + wp.tid()
        if i < items.end:
            own = vertex[i]
            w = weight[i]
            same = by_corner()
            corners = wp.int32(8)  # a loop to it is not unrolled, which would take seconds to compile
            for n in range(row_start[i], row_start[i + 1]):
                c = columns[n]
                if c >= i:
                    other = vertex[c]
                    v = weight[c]
                    block = blocks[n]
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
                                add_pair(matrix, items.slab, own[k], other[m], (w[k] * v[m]) * block)
            for m in range(8):
                block = mat33()
                for a in range(3):
                    for b in range(3):
                        block[a, b] = same[3 * m + a, b]
                for k in range(corners):
                    add_pair(matrix, items.slab, own[k], own[m], w[k] * block)

    return SimpleNamespace(grid_diagonal=grid_diagonal, grid_matrix=grid_matrix)


RESTRICT = """
    const real* __restrict__ x = (const real*)residual.data;
    const wp::int32* __restrict__ at = point.data;
    const real* __restrict__ w = weight.data;
    real* __restrict__ y = (real*)coarse_residual.data;
    wp::int32 k = row_start.data[first];
    for (wp::int32 v = first; v < end; ++v) {
        const wp::int32 last = row_start.data[v + 1];
        four sum = {0, 0, 0, 0};
        for (; k < last; ++k) sum += w[k] * three(x + 3 * at[k]);
        y[3 * v] = sum[0];
        y[3 * v + 1] = sum[1];
        y[3 * v + 2] = sum[2];
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
        const wp::int32 member = groups.member_of.data ? groups.member_of.data[i] : -1;
        if (member >= 0) z += three((const real*)groups.correction.data + 3 * member);
        y[3 * i] = z[0];
        y[3 * i + 1] = z[1];
        y[3 * i + 2] = z[2];
        product += r[0] * z[0] + r[1] * z[1] + r[2] * z[2];
    }
"""

STRIP = 16
"""Rows of the dense product that are added up together."""
WHOLE = 32000
"""The number that represents 1 in 16 bits, with room for rounding."""

DENSE = """
    typedef wp::int16 shorts __attribute__((ext_vector_type(8), aligned(2)));
    typedef real eight __attribute__((ext_vector_type(8)));
    const wp::int32 size = inverse.shape[0] / scale.shape[0];  // rows and columns
    const shorts* number = (const shorts*)inverse.data + 2 * (wp::int64)size * first;
    const real* s = scale.data;
    const real* x = (const real*)residual.data;
    real* y = (real*)solution.data;
    const auto at = [&](wp::int64 k) { return __builtin_convertvector(number[k], eight); };
    // a strip of 16 rows: their sums stay in registers while the columns are read one after the other
    for (wp::int32 b = first; b < end; ++b, number += 2 * (wp::int64)size) {
        eight low = 0, high = 0;
        for (wp::int32 k = 0; k < size; ++k) {
            const real v = s[k] * x[k];
            low += at(2 * k) * v;
            high += at(2 * k + 1) * v;
        }
        for (int l = 0; l < 8; ++l) {
            y[16 * b + l] = s[16 * b + l] * low[l];
            y[16 * b + 8 + l] = s[16 * b + 8 + l] * high[l];
        }
    }
"""


@cache
def cpu_grid_kernels(scalar: type) -> SimpleNamespace:
    """The kernels `restrict`, `prolong` and `dense` of one grid on the CPU."""
    Numbers, Vectors, Blocks = array_types(scalar)
    Weights, Groups = wp.array[wp.types.vector(8, scalar)], groups_type(scalar)
    types, module = real(scalar) + FOUR_TYPES, f"cpu_grids_{scalar.__name__}"

    @native_kernel(module, types + RESTRICT)
    def restrict(
        items: Items, row_start: Ints, point: Ints, weight: Numbers, residual: Vectors, coarse_residual: Vectors
    ):
        """P^T r: every grid vertex gathers the residual of the points it reaches."""

    @native_kernel(module, types + PROLONG + KEEP_PRODUCT)
    def prolong(
        items: Items,
        inverse_diagonal: Blocks,
        vertex: Cells,
        weight: Weights,
        coarse: Vectors,
        groups: Groups,
        residual: Vectors,
        correction: Vectors,
        dots: Dots,
    ):
        """z = D^-1 r + P z_coarse, with r . z, kept by iteration, and on the nodes the groups' correction.

        `coarse` has one more; other points are no members of groups.
        """

    @native_kernel(module, types + DENSE)
    def dense(items: Items, inverse: Shorts, scale: Numbers, residual: Vectors, solution: Vectors):
        """S A S r of strips, A in parts of `WHOLE`: of each strip column after column."""

    return SimpleNamespace(restrict=restrict, prolong=prolong, dense=dense)


BLOCK_LANES = 256
"""Threads that share a vertex of the coarsest grid: a CUDA block. Some reach 1600 nodes, for which a launch with
32 threads each took 13 us."""
VERTEX_LANES = 32
"""Threads that share a vertex of another grid whose vertices reach at least this many nodes on average."""
FEW_LANES = MEMBERS
"""Threads that share one of the other vertices; or a row of a group's block, each with a node."""
NODE_LANES = 4
"""Threads that share a node, each for whole cells that it lies in; three write a component."""
ROW_LANES = 32
"""Threads that share a row of the dense product."""
OCTET = 8
"""Numbers that a thread of the dense product reads at once; rows are padded to whole ones."""


LENGTHEN = """
    const unsigned pairs[4] = {octet.x, octet.y, octet.z, octet.w};
    float number[8];
    #pragma unroll
    for (int n = 0; n < 4; ++n)
        asm("{.reg .b16 low, high; mov.b32 {low, high}, %2; cvt.f32.f16 %0, low; cvt.f32.f16 %1, high;}"
            : "=f"(number[2 * n]), "=f"(number[2 * n + 1]) : "r"(pairs[n]));
"""
"""Eight numbers of 16 bits, read at once."""


@wp.func_native(f"""
const uint4* entries = reinterpret_cast<const uint4*>(matrix.data + (size_t)row * matrix.shape[1]);
const float4* factors = reinterpret_cast<const float4*>(vector.data);
float sum = 0.0f;
#pragma unroll 4
for (int k = lane; k < matrix.shape[1] / 8; k += 32) {{
    const uint4 octet = __ldcs(entries + k);  // read once: it must not push the vectors out of the cache
    const float4 x = factors[2 * k], y = factors[2 * k + 1];
    {LENGTHEN}
    sum += number[0] * x.x + number[1] * x.y + number[2] * x.z + number[3] * x.w
         + number[4] * y.x + number[5] * y.y + number[6] * y.z + number[7] * y.w;
}}
return sum;
""")
def part_of_product(matrix: HalfRows, vector: Singles, row: int, lane: int) -> wp.float32:
    """Contribution of one of ROW_LANES threads to a row of a product; it reads OCTET numbers at once, past the
    cache."""
    ...


@cache
def cuda_grid_kernels(scalar: type, number: type) -> SimpleNamespace:
    """The kernels `restrict`, `dense` and `prolong` in one precision; the coarsest grid always has float32.

    `number` is the type of the numbers of nodes and vertices.
    """
    add_lanes, add_row = lane_reducer(scalar), lane_reducer(wp.float32)
    vec3, vec4 = (wp.types.vector(size, scalar) for size in (3, 4))
    Numbers, _, Blocks = array_types(scalar)
    Fours, Places, Groups = wp.array[vec4], wp.array[number], groups_type(scalar)
    module = f"cuda_grids_{scalar.__name__}_{number.__name__}"
    corner, reads = ("unsigned short", 1) if number is wp.uint16 else ("int", 2)

    @wp.func_native(f"""{real(scalar)}
    struct alignas(16) Four {{ real x, y, z, unused; }};
    wp::vec_t<3, real> sum;
    #pragma unroll 1
    for (int grid = lane; grid < grids; grid += {NODE_LANES}) {{
        const size_t cell = (size_t)grid * nodes + node;
        alignas(16) {corner} at[{CORNERS}];
        #pragma unroll
        for (int n = 0; n < {reads}; ++n)
            reinterpret_cast<uint4*>(at)[n] = reinterpret_cast<const uint4*>(vertex.data)[{reads} * cell + n];
        const uint4 octet = reinterpret_cast<const uint4*>(weight.data)[cell];
        {LENGTHEN}
        #pragma unroll
        for (int n = 0; n < {CORNERS}; ++n) {{
            const Four vector = reinterpret_cast<const Four*>(coarse.data)[at[n]];
            sum[0] += number[n] * vector.x;
            sum[1] += number[n] * vector.y;
            sum[2] += number[n] * vector.z;
        }}
    }}
    return sum;
    """)
    def part_of_correction(
        vertex: Places, weight: Halves, coarse: Fours, grids: int, nodes: int, node: int, lane: int
    ) -> vec3:
        """Contribution of one of NODE_LANES threads to the correction of a node; it reads a whole cell at once."""
        ...

    @wp.func_native(f"""{real(scalar)}
    struct alignas(16) Four {{ real x, y, z, unused; }};
    wp::vec_t<3, real> sum;
    for (int k = first; k < end; k += 4 * apart) {{
        Four vector[4];
        real w[4];
        #pragma unroll
        for (int n = 0; n < 4; ++n) {{  // all are asked for before the first is waited for
            const int at = min(k + n * apart, end - 1);
            vector[n] = reinterpret_cast<const Four*>(residual.data)[point.data[at]];
            w[n] = k + n * apart < end ? float(weight.data[at]) : 0.0f;
        }}
        #pragma unroll
        for (int n = 0; n < 4; ++n) {{
            sum[0] += w[n] * vector[n].x;
            sum[1] += w[n] * vector[n].y;
            sum[2] += w[n] * vector[n].z;
        }}
    }}
    return sum;
    """)
    def part_of_residual(point: Places, weight: Halves, residual: Fours, first: int, end: int, apart: int) -> vec3:
        """Contribution of one of `apart` threads to a weighted sum."""
        ...

    @wp.func_native(f"""{real(scalar)}
    __shared__ real parts[{BLOCK_LANES // 32}][3];
    if (threadIdx.x % 32 == 0)
        for (int c = 0; c < 3; ++c) parts[threadIdx.x / 32][c] = value[c];
    __syncthreads();
    wp::vec_t<3, real> sum;
    for (int n = 0; n < {BLOCK_LANES // 32}; ++n)
        for (int c = 0; c < 3; ++c) sum[c] += parts[n][c];
    return sum;
    """)
    def add_warps(value: vec3) -> vec3:
        """The sum over the warps of a block, whose threads all call it, each with the sum of its warp."""
        ...

    @wp.kernel(module=module, enable_backward=False)
    def restrict(
        items: Items,
        coarsest: int,
        far: int,
        row_start: Ints,
        point: Places,
        weight: Halves,
        inverse_diagonal: Blocks,
        scale: wp.array[wp.vec3f],
        residual: Fours,
        groups: Groups,
        coarsest_residual: wp.array[wp.vec3f],
        correction: Fours,
    ):
        """P^T r, scaled for the `coarsest` first vertices, times D^-1 for the others.

        The coarsest have BLOCK_LANES threads each, the `far` next VERTEX_LANES, the others FEW_LANES, and so have
        the members of `node_groups` after them, whose correction it finds: a launch for them alone took a sixth
        of an iteration.
        """
        item = items.first + wp.tid()
        blocks = coarsest * BLOCK_LANES
        warps = blocks + far * VERTEX_LANES
        lanes = wp.int32(FEW_LANES)
        v = coarsest + far + (item - warps) // FEW_LANES
        if item < blocks:
            lanes = BLOCK_LANES
            v = item // BLOCK_LANES
        elif item < warps:
            lanes = VERTEX_LANES
            v = coarsest + (item - blocks) // VERTEX_LANES
        begin = wp.int32(0)
        stop = wp.int32(0)
        m = v - (row_start.shape[0] - 1)
        if item < items.end and m < 0:
            begin = row_start[v] + item % lanes
            stop = row_start[v + 1]
        total = part_of_residual(point, weight, residual, begin, stop, lanes)
        if item < items.end and m >= 0:
            group = groups.group_of[m]
            own_first = groups.first[group]
            size = 3 * (groups.first[group + 1] - own_first)
            k = item % lanes
            if 3 * k < size:
                own = residual[groups.nodes[own_first + k]]
                row = groups.start[group] + 3 * size * (m - own_first) + 3 * k
                for c in range(3):
                    for n in range(3):
                        total[c] += groups.inverse[row + size * c + n] * own[n]
        near = wp.min(lanes, VERTEX_LANES)
        total = vec3(add_lanes(total[0], near), add_lanes(total[1], near), add_lanes(total[2], near))
        if item < blocks:
            total = add_warps(total)
        if item < items.end and item % lanes == 0:
            if m >= 0:
                groups.correction[m] = total
            elif v < coarsest:
                single = wp.vec3f(wp.float32(total[0]), wp.float32(total[1]), wp.float32(total[2]))
                coarsest_residual[v] = wp.cw_mul(scale[v], single)
            else:
                corrected = inverse_diagonal[v - coarsest] * total
                correction[v] = vec4(corrected[0], corrected[1], corrected[2], scalar(0.0))

    @wp.kernel(module=module, enable_backward=False)
    def dense(items: Items, inverse: HalfRows, scale: Singles, residual: Singles, correction: Numbers):
        """The product with a dense inverse."""
        item = items.first + wp.tid()
        row = item // ROW_LANES
        value = wp.float32(0.0)
        if item < items.end:
            value = part_of_product(inverse, residual, row, item % ROW_LANES)
        value = add_row(value, ROW_LANES)
        if item < items.end and item % ROW_LANES == 0:
            correction[4 * (row // 3) + row % 3] = scalar(scale[row] * value)

    @wp.kernel(module=module, enable_backward=False)
    def prolong(
        items: Items,
        inverse_diagonal: Numbers,
        vertex: Places,
        weight: Halves,
        coarse: Fours,
        groups: Groups,
        residual: Fours,
        z: Numbers,
        r_dot_z: Dots,
    ):
        """z = D^-1 r + the groups' correction + the sum of P z_coarse over all grids, and r . z, by iteration."""
        item = items.first + wp.tid()
        i = item // NODE_LANES
        c = item % NODE_LANES
        k = 3 * i + c
        total = vec3()
        if item < items.end:
            nodes = items.end // NODE_LANES
            total = part_of_correction(vertex, weight, coarse, vertex.shape[0] // (CORNERS * nodes), nodes, i, c)
        total = vec3(
            add_lanes(total[0], NODE_LANES), add_lanes(total[1], NODE_LANES), add_lanes(total[2], NODE_LANES)
        )
        value = wp.float64(0.0)
        if item < items.end and c < 3:
            own = residual[i]
            corrected = component(total, c)
            for n in range(3):
                corrected += inverse_diagonal[3 * k + n] * own[n]
            m = groups.member_of[i]
            if m >= 0:
                corrected += component(groups.correction[m], c)
            z[k] = corrected
            value = wp.float64(component(own, c)) * wp.float64(corrected)
        add_sum(r_dot_z.products, r_dot_z.iteration[0], 0, value)

    return SimpleNamespace(restrict=restrict, dense=dense, prolong=prolong)
