"""Sums and maxima over all items of a launch."""

from functools import cache
from typing import Any

import warp as wp


@cache
def adder(cuda: bool) -> Any:
    """The function that adds a value of every item into sums[row, column].

    On CUDA a block adds up first: half a million atomics on one address cost more than the kernel.
    On the CPU a range of items runs in one thread and owns its cell; tiles are left out there because
    Warp keeps one tile storage for the process, which two threads would share.
    """

    @wp.func
    def add(sums: wp.array2d(dtype=wp.float64), row: int, column: int, value: wp.float64):
        if wp.static(cuda):
            wp.tile_atomic_add(sums[row], wp.tile_sum(wp.tile(value)), offset=(column,))
        else:
            sums[row, column] += value

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


@wp.func
def keep_largest(values: wp.array2d(dtype=wp.float64), row: int, column: int, value: wp.float64):
    """values[row, column] = max(itself, value); looks first, since most items are not the largest."""
    if value > values[row, column]:
        wp.atomic_max(values, row, column, value)
