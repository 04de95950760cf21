"""One kernel launch over all CPU cores, or one on CUDA.

Warp runs a CPU launch serially on the calling thread but lets go of the interpreter lock, so a range
split over threads runs at the same time. A kernel of the hot path therefore begins with the arguments
`first, end, slab`: it works on [first, end) and adds only into its own slab of an accumulator, which
keeps results free of races and, on the CPU, equal to the last bit from run to run.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from .errors import InputError

LEAST_SPLIT = 1024
"""Fewer items than this are run by the calling thread alone: waking another takes longer."""
CUDA_BLOCK = 256
"""Threads of a CUDA block; launches are padded to whole blocks because sums are reduced per block."""


def choose_device(name: str) -> str:
    """The Warp device for `auto`, `cpu` or `cuda:N`; InputError where it does not exist."""
    wp.init()
    if name == "auto":
        return "cuda:0" if wp.is_cuda_available() else "cpu"
    known = [str(device) for device in wp.get_devices()]
    if name not in known:
        raise InputError(f"device: '{name}' is not on this machine; choose auto or one of {', '.join(known)}")
    return name


def choose_threads(threads: int) -> int:
    """The asked number of CPU threads, or for 0 the number of cores this process may use."""
    if threads < 0:
        raise InputError(f"threads: must be 0 (all cores) or more, not {threads}")
    return threads or len(os.sched_getaffinity(0))


class Parallel:
    """Where launches run: `ranges` threads of the CPU, or a CUDA device (one range)."""

    def __init__(self, device: str = "auto", threads: int = 0) -> None:
        self.device = choose_device(device)
        self.is_cuda = self.device.startswith("cuda")
        self.ranges = 1 if self.is_cuda else choose_threads(threads)
        self._pool = ThreadPoolExecutor(self.ranges - 1) if self.ranges > 1 else None

    def split(self, size: int) -> np.ndarray:
        """Bounds of equal ranges of [0, size), shape (ranges + 1,)."""
        return np.linspace(0, size, self.ranges + 1).astype(np.int64)

    def record(
        self,
        kernel: Any,
        size: int | np.ndarray,
        inputs: Sequence[Any],
        outputs: Sequence[Any],
        least: int = LEAST_SPLIT,
    ) -> Callable[[], None]:
        """A launch of `kernel(first, end, slab, *inputs, *outputs)` to call many times.

        `size` is the number of items, or the bounds of the ranges where they should not be equal. Fewer
        items than `least` are not split.
        """
        bounds = self.split(size) if isinstance(size, int) else size
        if bounds[-1] < least:
            bounds = bounds[[0, -1]]
        commands = []
        for slab, (first, end) in enumerate(pairwise(bounds)):
            count = int(end - first)
            if count == 0:
                continue
            if self.is_cuda:
                count = -(-count // CUDA_BLOCK) * CUDA_BLOCK
            commands.append(
                wp.launch(
                    kernel,
                    dim=count,
                    inputs=[int(first), int(end), slab, *inputs],
                    outputs=list(outputs),
                    device=self.device,
                    block_dim=CUDA_BLOCK,
                    record_cmd=True,
                )
            )
        if not commands:
            return lambda: None
        if self._pool is None or len(commands) == 1:
            return commands[0].launch
        pool, (own, *others) = self._pool, commands

        def launch() -> None:
            futures = [pool.submit(command.launch) for command in others]
            own.launch()
            for future in futures:
                future.result()

        return launch

    def record_whole(
        self, kernel: Any, size: int, inputs: Sequence[Any], outputs: Sequence[Any]
    ) -> Callable[[], None]:
        """A launch of `kernel(*inputs, *outputs)` that is not split: the few items are not worth a thread."""
        command = wp.launch(
            kernel, dim=size, inputs=list(inputs), outputs=list(outputs), device=self.device, record_cmd=True
        )
        return command.launch  # pyright: ignore[reportOptionalMemberAccess]  (recorded launches are returned)
