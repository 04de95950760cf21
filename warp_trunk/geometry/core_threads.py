"""Independent work on the CPU, over all its cores."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from warp_trunk.system import usable_cores

Item = TypeVar("Item")
Result = TypeVar("Result")
_LEAST_ITEMS = 2_000
"""Fewer items are run by the calling thread alone."""


def launch_over_cores(
    kernel: Any, size: int, inputs: Sequence[Any], outputs: Sequence[Any], device: str = "cpu"
) -> None:
    """Runs `kernel(first, *inputs, *outputs)`, which works on item `first + tid`, on `size` items.

    Warp lets go of the interpreter while a kernel runs on the CPU, where it has one thread for a launch.
    """
    import warp as wp

    def launch_part(part: tuple[int, int]) -> None:
        wp.launch(kernel, dim=part[1] - part[0], inputs=[part[0], *inputs], outputs=outputs, device=device)

    if size < _LEAST_ITEMS or device != "cpu":
        launch_part((0, size))
        return
    launch_part((0, 1))  # alone, so that the kernel is compiled once
    cores = usable_cores()
    with ThreadPoolExecutor(cores) as pool:
        list(pool.map(launch_part, pairwise(np.linspace(1, size, cores + 1).astype(int).tolist())))


def each_over_cores(work: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
    """The results of `work` for the items, in their order; most of the work should be kernels or NumPy."""
    yield from map(work, items[:1])  # alone, so that a kernel is compiled once
    with ThreadPoolExecutor(usable_cores()) as pool:
        yield from pool.map(work, items[1:])
