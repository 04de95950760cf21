"""Steps on vectors of the free nodes, and the sums and maxima that they need.

Free nodes come first in every array: the projection of a step onto the prescribed bones is the length of its
launch (the mappings U of eq. 4.3 of [2]).
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from .arguments import Doubles, Items, Sums, array_types
from .native import native_kernel


@wp.func
def component(v: Any, c: int):
    """v[c], which CUDA would read from memory where c is not known in advance."""
    return wp.where(c == 0, v[0], wp.where(c == 1, v[1], v[2]))


@cache
def sums_reducer(count: int) -> Any:
    """The function that adds values of every item into as many columns of a row, at most 8.

    On CUDA a block of at least `count` warps adds up first, and all its threads must call it: half a million
    atomics on one address cost more than the kernel. Warp's tiles take one sum at a time, for longer. On the
    CPU a range of items runs in one thread and owns its cells.
    """
    values_type: Any = wp.types.vector(count, wp.float64)

    @wp.func_native(f"""
    #if defined(__CUDA_ARCH__)
    __shared__ double parts[{count}][32];
    const int lane = threadIdx.x % 32, warp = threadIdx.x / 32;
    #pragma unroll
    for (int k = 0; k < {count}; ++k) {{
        double value = values[k];
        for (int away = 16; away > 0; away /= 2) value += __shfl_xor_sync(0xffffffffu, value, away);
        if (lane == 0) parts[k][warp] = value;
    }}
    __syncthreads();
    if (warp < {count}) {{
        double value = lane < blockDim.x / 32 ? parts[warp][lane] : 0.0;
        for (int away = 16; away > 0; away /= 2) value += __shfl_xor_sync(0xffffffffu, value, away);
        if (lane == 0) atomicAdd(sums.data + (size_t)sums.shape[1] * row + column + warp, value);
    }}
    __syncthreads();  // the parts are free for another sum
    #else
    for (int k = 0; k < {count}; ++k) sums.data[(size_t)sums.shape[1] * row + column + k] += values[k];
    #endif
    """)
    def add(sums: Sums, row: int, column: int, values: values_type): ...

    return add


add_one = sums_reducer(1)
single: Any = wp.types.vector(1, wp.float64)


@wp.func
def add_sum(sums: Sums, row: int, column: int, value: wp.float64):
    """Adds a value of every item into sums[row, column]; see `sums_reducer`."""
    add_one(sums, row, column, single(value))


@cache
def lane_reducer(scalar: type) -> Any:
    """The function that adds up a value over neighbouring CUDA threads, a power of two of at most 32, for each."""

    @wp.func_native("""
    for (int away = lanes / 2; away > 0; away /= 2) value += __shfl_xor_sync(0xffffffffu, value, away);
    return value;
    """)
    def add_lanes(value: scalar, lanes: int) -> scalar: ...

    return add_lanes


@wp.func_native("""
    double* kept = values.data + (size_t)values.shape[1] * row + column;
    #if defined(__CUDA_ARCH__)
    double largest = value > 0.0 ? value : 0.0;
    for (int away = 16; away > 0; away /= 2) largest = fmax(largest, __shfl_xor_sync(0xffffffffu, largest, away));
    if (threadIdx.x % 32 == 0 && largest > *kept)
        atomicMax(reinterpret_cast<unsigned long long*>(kept), (unsigned long long)__double_as_longlong(largest));
    #else
    if (value > *kept) *kept = value;
    #endif
""")
def keep_largest(values: Sums, row: int, column: int, value: wp.float64):
    """Sets values[row, column] to the largest value of any item, none of which is below 0.

    It looks first, since most items are not the largest. On CUDA, where all threads of a warp must call it, one
    does for all, by their bits, whose order is the same: a maximum of doubles is a loop there, in which thousands
    of threads waited for each other (44 us where 4 will do). NaN is no largest.
    """


@cache
def slab_gatherer(scalar: type) -> wp.Kernel:
    """The kernel that adds up the slabs of an accumulator on the CPU; it loops over its range.

    Slab after slab, which are vector instructions: number after number took three times as long with 16 of them.
    """
    Numbers = wp.array[scalar]

    @native_kernel(
        f"slabs_{scalar.__name__}",
        """
    auto* __restrict__ total = values.data;
    for (int number = 1; number < slabs; ++number) {
        const auto* __restrict__ part = values.data + (wp::int64)number * size;
        for (int k = first; k < end; ++k) total[k] += part[k];
    }
    """,
    )
    def gather(items: Items, slabs: int, size: int, values: Numbers):
        """Adds all slabs, `size` numbers each, into the first one."""

    return gather


SLOPE, PREVIOUS_SLOPE, DIRECTION_SQUARED = range(3)
"""Columns of the products."""
PRODUCTS = 3
"""Their number."""
LEAST_PIVOT = wp.constant(wp.float64(1e-12))
"""The least part of a diagonal element that a Cholesky factor leaves."""


@cache
def vector_kernels(scalar: type) -> SimpleNamespace:
    """The kernels of the loop, in one precision."""
    add = sums_reducer(PRODUCTS)
    vec3 = wp.types.vector(3, scalar)
    _, Vectors, Blocks = array_types(scalar)
    module = f"vectors_{scalar.__name__}"
    products_type = wp.types.vector(PRODUCTS, wp.float64)

    @wp.kernel(module=module, enable_backward=False)
    def step(items: Items, length: Doubles, displacement: Vectors, direction: Vectors, trial: Vectors):
        """trial = displacement + length * direction, free nodes only."""
        i = items.first + wp.tid()
        if i < items.end:
            trial[i] = displacement[i] + scalar(length[0]) * direction[i]

    @wp.kernel(module=module, enable_backward=False)
    def products(items: Items, gradient: Vectors, direction: Vectors, previous: Vectors, products: Sums):
        """Products of the direction with the gradient, with an earlier gradient and with itself."""
        i = items.first + wp.tid()
        product_sums = products_type()
        if i < items.end:
            d = direction[i]
            product_sums[SLOPE] = wp.float64(wp.dot(gradient[i], d))
            product_sums[PREVIOUS_SLOPE] = wp.float64(wp.dot(previous[i], d))
            product_sums[DIRECTION_SQUARED] = wp.float64(wp.dot(d, d))
        add(products, items.slab, 0, product_sums)

    @wp.kernel(module=module, enable_backward=False)
    def extrapolate(
        items: Items,
        share: Doubles,
        part: Doubles,
        displacement: Vectors,
        earlier: Vectors,
        move: Vectors,
        bend: Vectors,
    ):
        """Takes note of the last move and a share of its change, and goes on by the move and a part of the change.

        Free nodes only; `earlier` becomes the displacement, which becomes the expected one.
        """
        i = items.first + wp.tid()
        if i < items.end:
            now = displacement[i]
            last = now - earlier[i]
            bend[i] += scalar(share[0]) * ((last - move[i]) - bend[i])
            move[i] = last
            earlier[i] = now
            displacement[i] = now + (last + scalar(part[0]) * bend[i])

    @wp.kernel(module=module, enable_backward=False)
    def color(items: Items, inverse_diagonal: Blocks, white: Vectors, colored: Vectors):
        """C^-T w for D^-1 = C C^T: of white noise, forces whose covariance is D, the diagonal blocks."""
        i = items.first + wp.tid()
        if i < items.end:
            a = wp.mat33d(inverse_diagonal[i])
            w = wp.vec3d(white[i])
            x = wp.sqrt(a[0, 0])
            xy = a[1, 0] / x
            xz = a[2, 0] / x
            y = wp.sqrt(wp.max(a[1, 1] - xy * xy, LEAST_PIVOT * a[1, 1]))  # rounding may leave nothing
            yz = (a[2, 1] - xz * xy) / y
            z = wp.sqrt(wp.max(a[2, 2] - xz * xz - yz * yz, LEAST_PIVOT * a[2, 2]))
            third = w[2] / z
            second = (w[1] - yz * third) / y
            colored[i] = vec3(wp.vec3d((w[0] - xy * second - xz * third) / x, second, third))

    @wp.kernel(module=module, enable_backward=False)
    def longest(items: Items, vectors: Vectors, column: int, longest: Sums):
        """Largest squared length of a vector, in a column."""
        i = items.first + wp.tid()
        squared = wp.float64(0.0)
        if i < items.end:
            squared = wp.float64(wp.length_sq(vectors[i]))
        keep_largest(longest, items.slab, column, squared)

    return SimpleNamespace(step=step, products=products, extrapolate=extrapolate, color=color, longest=longest)
