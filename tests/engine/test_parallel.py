"""Launches over ranges: every item once, in its range's slab."""

# Warp's annotations are values:
# pyright: reportInvalidTypeForm=false

import numpy as np
import pytest
import warp as wp
from warp_trunk.kernels.arguments import Items

from warp_trunk.engine.parallel import (
    Parallel,
    choose_device,
    choose_threads,
    in_sequence,
)
from warp_trunk.errors import InputError
from warp_trunk.system import usable_cores


@wp.kernel(enable_backward=False)
def visit_kernel(items: Items, step: int, visits: wp.array2d(dtype=wp.int32)):
    i = items.first + wp.tid()  # pyright: ignore[reportOperatorIssue]
    if i < items.end:
        visits[items.slab, i] = visits[items.slab, i] + step


def visits(threads: int, size: int, least: int = 1) -> np.ndarray:
    """How often each range visited each item after two launches."""
    parallel = Parallel("cpu", threads, least_split=least)
    out = wp.zeros((threads, max(size, 1)), dtype=wp.int32, device="cpu")
    launch = parallel.record(visit_kernel, size, [3], [out])
    launch()
    launch()
    return out.numpy()[:, :size]


@pytest.mark.parametrize("size", [0, 2, 1000])
@pytest.mark.parametrize("threads", [1, 3])
def test_every_item_once_by_one_range(threads: int, size: int) -> None:
    seen = visits(threads, size)
    assert (seen.sum(axis=0) == 6).all()
    assert ((seen > 0).sum(axis=0) == 1).all()
    assert np.ptp((seen > 0).sum(axis=1)) <= 1
    unsplit = visits(threads, size, least=size + 1)  # waking a thread costs more than it saves
    assert (unsplit[0] == 6).all()
    assert not unsplit[1:].any()


@wp.kernel(enable_backward=False)
def pass_on_kernel(items: Items, source: wp.array(dtype=wp.int32), taken: wp.array(dtype=wp.int32)):
    i = items.first + wp.tid()  # pyright: ignore[reportOperatorIssue]
    if i < items.end:
        taken[i] = source[(i + 1) % source.shape[0]]


@wp.kernel(enable_backward=False)
def count_down_kernel(items: Items, left: wp.array(dtype=wp.int32)):
    left[0] = left[0] - 1


@pytest.mark.parametrize("threads", [1, 3])
def test_a_loop_does_its_launches_one_after_the_other(threads: int) -> None:
    parallel, size, turns = Parallel("cpu", threads, least_split=1), 1001, 200
    passed, other = (wp.zeros(size, dtype=wp.int32, device="cpu") for _ in range(2))
    left = wp.zeros(1, dtype=wp.int32, device="cpu")
    forth, back = (parallel.record(pass_on_kernel, size, [a], [b]) for a, b in ((passed, other), (other, passed)))
    count = parallel.record(count_down_kernel, np.array([0, 1]), [], [left])
    run = parallel.graph(parallel.repeat(left, in_sequence(count, forth, back)))
    passed.assign(np.arange(size, dtype=np.int32))
    for done in (1, 2):
        left.fill_(turns)
        run()
        np.testing.assert_array_equal(passed.numpy(), np.roll(np.arange(size), -2 * turns * done))


def test_devices_and_threads() -> None:
    assert choose_threads(0) == usable_cores() == Parallel("cpu", 0).ranges
    with pytest.raises(InputError, match="threads"):
        choose_threads(-2)
    with pytest.raises(InputError, match=r"device.*cpu"):
        choose_device("tpu")
