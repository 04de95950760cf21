"""Sums and maxima over a launch against NumPy, on every device there is."""

# Warp's annotations are values:
# pyright: reportInvalidTypeForm=false

from typing import Any

import numpy as np
import pytest
import warp as wp
from warp_trunk.kernels.vectors import max_reducer, sums_reducer

from warp_trunk.engine.parallel import Parallel

wp.init()
DEVICES = [str(device) for device in wp.get_devices()]
ITEMS = 1000
"""Of which the last CUDA block holds a part."""
ROW, COLUMN = 1, 2


def reducing_kernel(cuda: bool, count: int) -> Any:
    """A kernel that adds up the items of a table, and keeps the largest of its first column."""
    add, keep_largest = sums_reducer(cuda, count), max_reducer(cuda)
    values_type: Any = wp.types.vector(count, wp.float64)

    @wp.kernel(module="unique", enable_backward=False)
    def reduce_kernel(
        first: int,
        end: int,
        slab: int,
        table: wp.array(dtype=values_type),
        sums: wp.array(dtype=wp.float64, ndim=2),
        largest: wp.array(dtype=wp.float64, ndim=2),
    ):
        i = first + wp.tid()  # pyright: ignore[reportOperatorIssue]
        values = values_type()
        if i < end:
            values = table[i]
        add(sums, ROW, COLUMN, values)
        keep_largest(largest, ROW, COLUMN, values[0])

    return reduce_kernel


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("count", [1, 6, 8])
def test_columns_are_added_up_and_the_largest_is_kept(device: str, count: int) -> None:
    parallel, generator = Parallel(device, threads=1), np.random.default_rng(count)
    table = generator.integers(-1000, 1000, size=(ITEMS, count)).astype(float)  # whose sums are exact
    sums, largest = (wp.zeros((3, 16), dtype=wp.float64, device=device) for _ in range(2))
    given = wp.array(table, dtype=wp.types.vector(count, wp.float64), device=device)
    launch = parallel.record(reducing_kernel(parallel.is_cuda, count), ITEMS, [given], [sums, largest])
    for times in (1, 2):
        launch()
        expected = np.zeros((3, 16))
        expected[ROW, COLUMN : COLUMN + count] = times * table.sum(axis=0)
        assert np.array_equal(sums.numpy(), expected)
        assert np.unique(np.nonzero(largest.numpy())).tolist() == [ROW, COLUMN]
        assert largest.numpy()[ROW, COLUMN] == table[:, 0].max()


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(
    ("values", "kept"), [([np.nan, 1e-300], 1e-300), ([-1.0, -0.0], 0.0), ([1.0, np.inf], np.inf)]
)
def test_only_numbers_above_zero_are_kept(device: str, values: list[float], kept: float) -> None:
    parallel = Parallel(device, threads=1)
    sums, largest = (wp.zeros((3, 16), dtype=wp.float64, device=device) for _ in range(2))
    given = wp.array(np.array(values)[:, None], dtype=wp.types.vector(1, wp.float64), device=device)
    parallel.record(reducing_kernel(parallel.is_cuda, 1), len(values), [given], [sums, largest])()
    assert largest.numpy()[ROW, COLUMN] == kept
