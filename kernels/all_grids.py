"""A step of conjugate gradients and the preconditioner on all grids at once, for CUDA.

There a launch costs more than most of its work, so that every grid hangs on the nodes, and the step goes with the
transfers: the residual is restricted as it will be, and set where corrections are prolonged. Grid vertices are
numbered through, those of the coarsest grid first: they reach most nodes, and the longest work should begin first.
Weights and the dense inverse have 16 bits: they make a preconditioner, and nothing of the solution. The inverse is
read past the cache, which has no room for all that an iteration reads.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .conjugate_gradient import stepping
from .multilevel import KEPT
from .reduction import adder, lane_adder

VERTEX_LANES = 32
"""Threads that share a grid vertex that reaches at least so many nodes."""
FEW_LANES = 8
"""Threads that share one of the other vertices."""
NODE_LANES = 4
"""Threads that share a node, each for whole cells that it lies in; three write a component."""
CORNERS = 8
"""Corners of a cell."""
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
    const uint4 octet = __ldcs(entries + k);
    const float4 x = factors[2 * k], y = factors[2 * k + 1];
    {LENGTHEN}
    sum += number[0] * x.x + number[1] * x.y + number[2] * x.z + number[3] * x.w
         + number[4] * y.x + number[5] * y.y + number[6] * y.z + number[7] * y.w;
}}
return sum;
""")
def part_of_product(
    matrix: wp.array2d(dtype=wp.float16), vector: wp.array(dtype=wp.float32), row: wp.int32, lane: wp.int32
) -> wp.float32:
    """What one of ROW_LANES threads adds to a row of a product; it reads OCTET numbers at once, past the cache."""
    ...


@wp.kernel(enable_backward=False)
def scale_and_shorten(
    matrix: wp.array(dtype=wp.float32, ndim=2),
    scale: wp.array(dtype=wp.float32),
    scaled: wp.array(dtype=wp.float16, ndim=2),
):
    """A symmetric matrix by the scales of its rows and columns, in 16 bits; see `KEPT`."""
    i, k = wp.tid()
    share = matrix[i, k] / (scale[i] * scale[k])
    scaled[i, k] = wp.float16(wp.where(i == k, share, KEPT * share))


@wp.kernel(enable_backward=False)
def shorten(values: wp.array(dtype=wp.float32), shortened: wp.array(dtype=wp.float16)):
    """The values in 16 bits."""
    i = wp.tid()
    shortened[i] = wp.float16(values[i])


@cache
def all_grids_kernels(scalar: type, number: type) -> SimpleNamespace:
    """The kernels `restrict`, `dense` and `prolong` in one precision; the coarsest grid always has float32.

    `number` is the type of the numbers of nodes and vertices.
    """
    add, add_lanes, add_row = adder(True), lane_adder(scalar), lane_adder(wp.float32)
    vec3, vec4 = (wp.types.vector(size, scalar) for size in (3, 4))
    mat33 = wp.types.matrix((3, 3), scalar)
    corner, reads = ("unsigned short", 1) if number is wp.uint16 else ("int", 2)
    real = "float" if scalar is wp.float32 else "double"

    @wp.func_native(f"""
    struct alignas(16) Four {{ {real} x, y, z, unused; }};
    wp::vec_t<3, {real}> sum;
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
        vertex: wp.array(dtype=number),
        weight: wp.array(dtype=wp.float16),
        coarse: wp.array(dtype=vec4),
        grids: wp.int32,
        nodes: wp.int32,
        node: wp.int32,
        lane: wp.int32,
    ) -> vec3:
        """What one of NODE_LANES threads adds to the correction of a node; it reads a whole cell at once."""
        ...

    @wp.func_native("""
    decltype(r.data[0] + r.data[0]) sum;
    const auto* taken = step != 0 ? q.data : r.data;  // nobody has set q before the first step
    for (int k = first; k < end; k += 4 * apart) {
        int node[4];
        decltype(+sum[0]) w[4];
        #pragma unroll
        for (int n = 0; n < 4; ++n) {  // all are asked for before the first is waited for
            const int at = min(k + n * apart, end - 1);
            node[n] = point.data[at];
            w[n] = k + n * apart < end ? float(weight.data[at]) : 0.0f;
        }
        #pragma unroll
        for (int n = 0; n < 4; ++n) {
            const decltype(sum) vector = r.data[node[n]] - step * taken[node[n]];
            sum[0] += w[n] * vector[0];
            sum[1] += w[n] * vector[1];
            sum[2] += w[n] * vector[2];
        }
    }
    return sum;
    """)
    def part_of_residual(
        point: wp.array(dtype=number),
        weight: wp.array(dtype=wp.float16),
        r: wp.array(dtype=vec3),
        q: wp.array(dtype=vec3),
        step: scalar,
        first: wp.int32,
        end: wp.int32,
        apart: wp.int32,
    ) -> vec3:
        """What one of `apart` threads adds to a weighted sum of r - step q."""
        ...

    @wp.func_native(f"return __shfl_sync(0xffffffffu, value, lane, {NODE_LANES});")
    def of_lane(value: scalar, lane: wp.int32) -> scalar:
        """The value of one of the threads of a node."""
        ...

    @wp.kernel(module="unique", enable_backward=False)
    def restrict_kernel(
        first: int,
        end: int,
        slab: int,
        steps: int,
        coarsest: int,
        far: int,
        row_start: wp.array(dtype=wp.int32),
        point: wp.array(dtype=number),
        weight: wp.array(dtype=wp.float16),
        inverse_diagonal: wp.array(dtype=mat33),
        scale: wp.array(dtype=wp.vec3f),
        iteration: wp.array(dtype=wp.int32),
        r_dot_z: wp.array(dtype=wp.float64, ndim=2),
        p_dot_q: wp.array(dtype=wp.float64, ndim=2),
        r: wp.array(dtype=vec3),
        q: wp.array(dtype=vec3),
        coarsest_residual: wp.array(dtype=wp.vec3f),
        correction: wp.array(dtype=vec4),
    ):
        """P^T r, scaled for the `coarsest` first vertices, times D^-1 for the others; r after a step, if any.

        The `far` first vertices have VERTEX_LANES threads each, the others FEW_LANES.
        """
        item = first + wp.tid()
        lanes = wp.where(item < far * VERTEX_LANES, VERTEX_LANES, FEW_LANES)
        v = wp.where(
            item < far * VERTEX_LANES, item // VERTEX_LANES, far + (item - far * VERTEX_LANES) // FEW_LANES
        )
        begin = wp.int32(0)
        stop = wp.int32(0)
        if item < end:
            begin = row_start[v] + item % lanes
            stop = row_start[v + 1]
        step = scalar(0.0)
        if steps == 1:
            step = scalar(stepping(r_dot_z, p_dot_q, iteration[0], 1))
        total = part_of_residual(point, weight, r, q, step, begin, stop, lanes)
        total = vec3(add_lanes(total[0], lanes), add_lanes(total[1], lanes), add_lanes(total[2], lanes))
        if item < end and item % lanes == 0:
            if v < coarsest:
                single = wp.vec3f(wp.float32(total[0]), wp.float32(total[1]), wp.float32(total[2]))
                coarsest_residual[v] = wp.cw_mul(scale[v], single)
            else:
                corrected = inverse_diagonal[v - coarsest] * total
                correction[v] = vec4(corrected[0], corrected[1], corrected[2], scalar(0.0))

    @wp.kernel(module="unique", enable_backward=False)
    def dense_kernel(
        first: int,
        end: int,
        slab: int,
        steps: int,
        inverse: wp.array(dtype=wp.float16, ndim=2),
        scale: wp.array(dtype=wp.float32),
        residual: wp.array(dtype=wp.float32),
        correction: wp.array(dtype=scalar),
        iteration: wp.array(dtype=wp.int32),
    ):
        """The product with a dense inverse. It counts the iteration, too: here nobody reads its number."""
        item = first + wp.tid()
        row = item // ROW_LANES
        value = wp.float32(0.0)
        if item < end:
            value = part_of_product(inverse, residual, row, item % ROW_LANES)
        value = add_row(value, ROW_LANES)
        if item < end and item % ROW_LANES == 0:
            correction[4 * (row // 3) + row % 3] = scalar(scale[row] * value)
        if item == 0:
            iteration[0] = iteration[0] + steps

    @wp.kernel(module="unique", enable_backward=False)
    def prolong_kernel(
        first: int,
        end: int,
        slab: int,
        steps: int,
        inverse_diagonal: wp.array(dtype=scalar),
        vertex: wp.array(dtype=number),
        weight: wp.array(dtype=wp.float16),
        coarse: wp.array(dtype=vec4),
        iteration: wp.array(dtype=wp.int32),
        p_dot_q: wp.array(dtype=wp.float64, ndim=2),
        p: wp.array(dtype=scalar),
        q: wp.array(dtype=scalar),
        x: wp.array(dtype=scalar),
        r: wp.array(dtype=scalar),
        z: wp.array(dtype=scalar),
        r_dot_z: wp.array(dtype=wp.float64, ndim=2),
    ):
        """z = D^-1 r + the sum of P z_coarse over all grids, and r . z, kept by iteration.

        Where the iteration `steps`, x and r do so first.
        """
        item = first + wp.tid()
        i = item // NODE_LANES
        c = item % NODE_LANES
        k = 3 * i + c
        j = iteration[0]
        own = scalar(0.0)
        row = vec3()
        total = vec3()
        if item < end:
            if c < 3:
                row = vec3(inverse_diagonal[3 * k], inverse_diagonal[3 * k + 1], inverse_diagonal[3 * k + 2])
                own = r[k]
                if steps == 1:
                    step = scalar(stepping(r_dot_z, p_dot_q, j - 1, 1))
                    own -= step * q[k]
                    r[k] = own
                    x[k] = x[k] + step * p[k]
            nodes = end // NODE_LANES
            total = part_of_correction(vertex, weight, coarse, vertex.shape[0] // (CORNERS * nodes), nodes, i, c)
        total = vec3(
            add_lanes(total[0], NODE_LANES), add_lanes(total[1], NODE_LANES), add_lanes(total[2], NODE_LANES)
        )
        residual = vec3(of_lane(own, 0), of_lane(own, 1), of_lane(own, 2))
        value = wp.float64(0.0)
        if item < end and c < 3:
            corrected = wp.where(c == 0, total[0], wp.where(c == 1, total[1], total[2])) + wp.dot(row, residual)
            z[k] = corrected
            value = wp.float64(own) * wp.float64(corrected)
        add(r_dot_z, j, 0, value)

    return SimpleNamespace(restrict=restrict_kernel, dense=dense_kernel, prolong=prolong_kernel)
