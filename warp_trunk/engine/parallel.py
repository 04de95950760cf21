"""Launches of kernels over all CPU cores, or on CUDA.

Warp runs a CPU launch on the calling thread alone. Here the range of a launch is split over the threads of a
`Team`, which runs launches that follow each other as one program. A kernel of the hot path takes `Items` first: it
works on a range and adds only into its own slab of an accumulator, which keeps results free of races and, on the
CPU, equal to the last bit from run to run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial, wraps
from itertools import pairwise
from typing import Any, ParamSpec, TypeVar

import numpy as np
import warp as wp

from warp_trunk.errors import InputError
from warp_trunk.kernels.arguments import Items, filled
from warp_trunk.kernels.native import NativeKernel
from warp_trunk.kernels.starting import ENGINE, start_warp
from warp_trunk.kernels.synchronization import clear_kernel, copy_to_host_kernel
from warp_trunk.kernels.vectors import slab_gatherer
from warp_trunk.system import usable_cores

from .team import Step, Team

Launch = Callable[[], None]
"""A recorded launch, to call many times."""
LEAST_SPLIT = 4096
"""Fewer items than this are run by the calling thread alone: to wait for another takes longer."""
CUDA_BLOCK = 256
"""Threads of most CUDA blocks; launches are padded to whole blocks because sums are reduced per block."""
P = ParamSpec("P")
R = TypeVar("R")


def takes_turns(function: Callable[P, R]) -> Callable[P, R]:
    """The function for one thread of the process at a time; see `ENGINE`."""

    @wraps(function)
    def alone(*arguments: P.args, **named: P.kwargs) -> R:
        with ENGINE:
            return function(*arguments, **named)

    return alone


def choose_device(name: str) -> str:
    """The Warp device for `auto`, `cpu` or `cuda:N`; InputError where it does not exist."""
    start_warp()
    if name == "auto":
        return "cuda:0" if wp.is_cuda_available() else "cpu"
    devices = [str(device) for device in wp.get_devices()]
    if name not in devices:
        raise InputError(f"device: '{name}' is not on this machine; choose auto or one of {', '.join(devices)}")
    return name


MOST_THREADS = 1024
"""More would only wait for each other."""


def choose_threads(threads: int) -> int:
    """The asked number of CPU threads, or for 0 the number of cores this process may use."""
    if not 0 <= threads <= MOST_THREADS:
        raise InputError(f"threads: must be 0 (all cores) to {MOST_THREADS}, not {threads}")
    return threads or usable_cores()


class Parallel:
    """Where launches run: `ranges` threads of the CPU, or a CUDA device (one range).

    Launches of fewer items than `least_split` run on the calling thread alone.
    """

    def __init__(self, device: str = "auto", threads: int = 0, *, least_split: int = LEAST_SPLIT) -> None:
        self.device = choose_device(device)
        self.least_split = least_split
        self.is_cuda = self.device.startswith("cuda")
        self.ranges = 1 if self.is_cuda else choose_threads(threads)
        self._team = Team(self.ranges)

    def split(self, size: int) -> np.ndarray:
        """Bounds of equal ranges of [0, size), shape (ranges + 1,)."""
        return np.linspace(0, size, self.ranges + 1).astype(np.int64)

    def record(
        self,
        kernel: Any,
        size: int | np.ndarray,
        inputs: Sequence[Any],
        outputs: Sequence[Any],
        block: int = CUDA_BLOCK,
    ) -> Launch:
        """A launch of `kernel(items, *inputs, *outputs)` to call many times.

        `size` is the number of items, which are not split where they are fewer than `least_split`, or the bounds
        of the ranges. A `NativeKernel` loops over a range itself on the CPU. `block` is the number of threads of a
        CUDA block.
        """
        if isinstance(size, np.ndarray):
            bounds = size.astype(np.int64)
        else:
            bounds = self.split(size) if size >= self.least_split else np.array([0, size])
        commands: list[Any] = []
        for slab, (first, end) in enumerate(pairwise(bounds.tolist())):
            dim = -(-(end - first) // block) * block if self.is_cuda else end - first
            if isinstance(kernel, NativeKernel) and not self.is_cuda:
                dim = 1
            arguments = [filled(Items, first=first, end=end, slab=slab), *inputs, *outputs]
            commands.append(
                wp.launch(kernel, dim, arguments, device=self.device, block_dim=block, record_cmd=True)
                if first < end
                else None
            )
        if self.is_cuda:
            return commands[0].launch if any(commands) else nothing
        return _Recorded(self._team, [Step(tuple(commands))] if any(commands) else [])

    def clear(self, array: wp.array) -> Launch:
        """A launch that sets an array to zero; on the CPU all threads do."""
        if self.is_cuda:
            return array.zero_
        return self.record(clear_kernel, array.size * _size_of(array), [], [_bytes(array)])

    def gather(self, slabs: wp.array, scalar: Any) -> Launch:
        """A launch that adds up the slabs of an accumulator, shape (ranges, ...), into the first one."""
        if self.ranges == 1:
            return nothing
        size = slabs.size * _size_of(slabs) // wp.types.type_size_in_bytes(scalar) // self.ranges
        arguments = [self.ranges, size, view(slabs, scalar, self.ranges * size)]
        return self.record(slab_gatherer(scalar), size, arguments, [])

    def repeat(self, running: wp.array, work: Launch) -> Launch:
        """A launch of recorded work, once and again as long as the first number of `running` is not 0 after it.

        On CUDA it is not launched at all where that is 0 before it.
        """
        if self.is_cuda:
            return lambda: wp.capture_while(running, work)
        assert isinstance(work, _Recorded)
        *steps, last = work.steps
        return _Recorded(self._team, [*steps, Step(last.commands, running, len(steps))])

    def graph(self, *launches: Launch) -> Launch:
        """Several launches as one: on CUDA a graph, which the host launches in the time of one kernel."""
        work = in_sequence(*launches)
        if not self.is_cuda:
            return work
        with ENGINE:
            wp.capture_begin(self.device)
            try:
                work()
            finally:
                graph = wp.capture_end(self.device)
        return partial(_replay, graph, work)

    def wait(self) -> None:
        """Waits until all that this thread has launched is done."""
        if self.is_cuda:
            wp.synchronize_stream(self.device)


def _replay(graph: wp.Graph, held: Launch) -> None:
    """Launches a graph. It holds what was captured: a graph does not hold the arrays of its launches."""
    wp.capture_launch(graph)


def nothing() -> None:
    """A launch of nothing."""


def in_sequence(*launches: Launch) -> Launch:
    """Several launches as one, in their order; those recorded for the CPU are one program."""
    joined: list[Launch] = []
    for each in launches:
        if each is nothing:
            continue
        last = joined[-1] if joined else None
        if isinstance(each, _Recorded) and isinstance(last, _Recorded) and each.team is last.team:
            joined[-1] = _Recorded(each.team, [*last.steps, *each.steps])
        else:
            joined.append(each)
    if len(joined) < 2:
        return joined[0] if joined else nothing

    def launch() -> None:
        for each in joined:
            each()

    return launch


class _Recorded:
    """Steps on the CPU, as a launch; they become a program when they are first launched."""

    def __init__(self, team: Team, steps: Sequence[Step]) -> None:
        self.team, self.steps = team, steps
        self._call: Launch | None = None

    def __call__(self) -> None:
        """Runs the steps."""
        if not self.steps:
            return
        with ENGINE:
            if self._call is None:
                self._call = self.team.program(self.steps)
            self._call()


def _size_of(array: wp.array) -> int:
    return wp.types.type_size_in_bytes(array.dtype)


def _bytes(array: wp.array) -> wp.array:
    return view(array, wp.uint8, array.size * _size_of(array))


def view(array: wp.array, dtype: Any, size: int, device: Any = None) -> wp.array:
    """The same memory with elements of another type; seen from another device, if that can reach it."""

    def let_go(pointer: int, capacity: int, held: wp.array = array) -> None:
        """Holds the array as long as the view."""

    return wp.array(ptr=array.ptr, shape=(size,), dtype=dtype, device=device or array.device, deleter=let_go)


class Readback:
    """A small array that the host reads often, copied to pinned memory as part of the work that computes it.

    On CUDA a copy between two kernels makes each wait for an engine of its own, about 10 us in all; a kernel that
    writes to the host's memory takes 2, and the host waits for the stream alone.
    """

    def __init__(self, parallel: Parallel, array: wp.array[Any, Any]) -> None:
        """For an array, shape (...), whose numbers of float64 are few."""
        self._parallel = parallel
        self.send: Launch = nothing
        """Begins to copy the array as it is after all earlier launches; can be part of a graph."""
        host = array
        if parallel.is_cuda:
            host = wp.empty_like(array, device="cpu", pinned=True)
            self.send = partial(wp.copy, host, array)
            if array.dtype is wp.float64:
                size = math.prod(array.shape)
                target = view(host, wp.float64, size, device=array.device)
                self.send = parallel.record(copy_to_host_kernel, size, [view(array, wp.float64, size)], [target])
        self._values = host.numpy()

    def read(self) -> np.ndarray:
        """The values sent last, shape of the array; waits for all that this thread has launched."""
        self._parallel.wait()
        return self._values
