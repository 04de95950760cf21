"""Transfers between the nodes and all grids of the preconditioner at once, for CUDA.

There a launch costs more than most of its work, so that every grid hangs on the nodes. Grid vertices are numbered
through, those of the coarsest grid first: they reach most nodes, and what takes longest should begin first.
The dense inverse is read past the cache, which has no room for all that an iteration reads.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .reduction import adder, lane_adder

VERTEX_LANES = 32
"""Threads that share a grid vertex."""
CORNERS = 8
"""Threads that share a node, one for each corner of the cells it lies in."""
ROW_LANES = 32
"""Threads that share a row of the dense product."""
QUAD = 4
"""Numbers that a thread of the dense product reads at once; rows are padded to whole ones."""


@wp.func_native("""
const float4* entries = reinterpret_cast<const float4*>(matrix.data + (size_t)row * matrix.shape[1]);
const float4* factors = reinterpret_cast<const float4*>(vector.data);
float sum = 0.0f;
#pragma unroll 4
for (int k = lane; k < matrix.shape[1] / 4; k += 32) {
    const float4 a = __ldcs(entries + k), x = factors[k];
    sum += a.x * x.x + a.y * x.y + a.z * x.z + a.w * x.w;
}
return sum;
""")
def part_of_product(
    matrix: wp.array2d(dtype=wp.float32), vector: wp.array(dtype=wp.float32), row: wp.int32, lane: wp.int32
) -> wp.float32:
    """What one of ROW_LANES threads adds to a row of a product; it reads QUAD numbers at once, past the cache."""
    ...


@cache
def all_grids_kernels(scalar: type) -> SimpleNamespace:
    """The kernels `restrict`, `dense` and `prolong` in one precision; the coarsest grid always has float32."""
    add, add_lanes, add_row = adder(True), lane_adder(scalar), lane_adder(wp.float32)
    vec3 = wp.types.vector(3, scalar)
    mat33 = wp.types.matrix((3, 3), scalar)

    @wp.kernel(module="unique", enable_backward=False)
    def restrict_kernel(
        first: int,
        end: int,
        slab: int,
        coarsest: int,
        row_start: wp.array(dtype=wp.int32),
        point: wp.array(dtype=wp.int32),
        weight: wp.array(dtype=scalar),
        inverse_diagonal: wp.array(dtype=mat33),
        residual: wp.array(dtype=vec3),
        coarsest_residual: wp.array(dtype=wp.vec3f),
        correction: wp.array(dtype=vec3),
    ):
        """P^T r of the `coarsest` first vertices, D^-1 P^T r of the others."""
        item = first + wp.tid()
        v = item // VERTEX_LANES
        lane = item % VERTEX_LANES
        total = vec3()
        if item < end:
            for k in range(row_start[v] + lane, row_start[v + 1], VERTEX_LANES):
                total += weight[k] * residual[point[k]]
        total = vec3(
            add_lanes(total[0], VERTEX_LANES), add_lanes(total[1], VERTEX_LANES), add_lanes(total[2], VERTEX_LANES)
        )
        if item < end and lane == 0:
            if v < coarsest:
                coarsest_residual[v] = wp.vec3f(wp.float32(total[0]), wp.float32(total[1]), wp.float32(total[2]))
            else:
                correction[v] = inverse_diagonal[v - coarsest] * total

    @wp.kernel(module="unique", enable_backward=False)
    def dense_kernel(
        first: int,
        end: int,
        slab: int,
        inverse: wp.array(dtype=wp.float32, ndim=2),
        residual: wp.array(dtype=wp.float32),
        correction: wp.array(dtype=scalar),
    ):
        """The product with a dense inverse."""
        item = first + wp.tid()
        row = item // ROW_LANES
        value = wp.float32(0.0)
        if item < end:
            value = part_of_product(inverse, residual, row, item % ROW_LANES)
        value = add_row(value, ROW_LANES)
        if item < end and item % ROW_LANES == 0:
            correction[row] = scalar(value)

    @wp.kernel(module="unique", enable_backward=False)
    def prolong_kernel(
        first: int,
        end: int,
        slab: int,
        inverse_diagonal: wp.array(dtype=mat33),
        vertex: wp.array(dtype=wp.int32),
        weight: wp.array(dtype=scalar),
        coarse: wp.array(dtype=vec3),
        residual: wp.array(dtype=vec3),
        correction: wp.array(dtype=vec3),
        iteration: wp.array(dtype=wp.int32),
        products: wp.array(dtype=wp.float64, ndim=2),
    ):
        """z = D^-1 r + the sum of P z_coarse over all grids, and r . z, kept by iteration."""
        item = first + wp.tid()
        i = item // CORNERS
        z = vec3()
        value = wp.float64(0.0)
        if item < end:
            for k in range(item, vertex.shape[0], CORNERS * residual.shape[0]):
                z += weight[k] * coarse[vertex[k]]
        z = vec3(add_lanes(z[0], CORNERS), add_lanes(z[1], CORNERS), add_lanes(z[2], CORNERS))
        if item < end and item % CORNERS == 0:
            r = residual[i]
            z += inverse_diagonal[i] * r
            correction[i] = z
            value = wp.float64(wp.dot(r, z))
        add(products, iteration[0], 0, value)

    return SimpleNamespace(restrict=restrict_kernel, dense=dense_kernel, prolong=prolong_kernel)
