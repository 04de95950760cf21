"""Sums and maxima over all items of a launch."""

from functools import cache
from typing import Any

import warp as wp


@cache
def adder(cuda: bool) -> Any:
    """The function that adds a value of every item into sums[row, column]; see `columns_adder`."""
    add_columns = columns_adder(cuda, 1)
    one: Any = wp.types.vector(1, wp.float64)

    @wp.func
    def add(sums: wp.array2d(dtype=wp.float64), row: int, column: int, value: wp.float64):
        add_columns(sums, row, column, one(value))

    return add


@cache
def columns_adder(cuda: bool, count: int) -> Any:
    """The function that adds values of every item into as many columns of a row, at most 8.

    On CUDA a block of at least `count` warps adds up first, and all its threads must call it: half a million
    atomics on one address cost more than the kernel. Warp's tiles take one sum at a time, for longer. On the
    CPU a range of items runs in one thread and owns its cells.
    """
    values_type: Any = wp.types.vector(count, wp.float64)

    @wp.func_native(f"""
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
    """)
    def add_over_block(sums: wp.array2d(dtype=wp.float64), row: int, column: int, values: values_type): ...

    @wp.func
    def add(sums: wp.array2d(dtype=wp.float64), row: int, column: int, values: values_type):
        if wp.static(cuda):
            add_over_block(sums, row, column, values)
        else:
            for k in range(wp.static(count)):
                sums[row, column + k] += values[k]

    return add


@cache
def lane_adder(scalar: type) -> Any:
    """The function that adds up a value over neighbouring CUDA threads, a power of two of at most 32, for each."""

    @wp.func_native("""
    for (int away = lanes / 2; away > 0; away /= 2) value += __shfl_xor_sync(0xffffffffu, value, away);
    return value;
    """)
    def add_lanes(value: scalar, lanes: wp.int32) -> scalar: ...

    return add_lanes


@cache
def largest_keeper(cuda: bool) -> Any:
    """The function that sets values[row, column] to the largest value of any item, none of which is below 0.

    It looks first, since most items are not the largest. On CUDA, where all threads of a warp must call it, one
    does for all, by their bits, whose order is the same: a maximum of doubles is a loop there, in which thousands
    of threads waited for each other (44 us where 4 will do). NaN is no largest.
    """

    @wp.func_native("""
    double largest = value > 0.0 ? value : 0.0;
    for (int away = 16; away > 0; away /= 2) largest = fmax(largest, __shfl_xor_sync(0xffffffffu, largest, away));
    double* kept = values.data + (size_t)values.shape[1] * row + column;
    if (threadIdx.x % 32 == 0 && largest > *kept)
        atomicMax(reinterpret_cast<unsigned long long*>(kept), (unsigned long long)__double_as_longlong(largest));
    """)
    def keep_over_warp(values: wp.array2d(dtype=wp.float64), row: int, column: int, value: wp.float64): ...

    @wp.func
    def keep_largest(values: wp.array2d(dtype=wp.float64), row: int, column: int, value: wp.float64):
        if wp.static(cuda):
            keep_over_warp(values, row, column, value)
        elif value > values[row, column]:
            values[row, column] = value

    return keep_largest
