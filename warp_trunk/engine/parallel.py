"""One kernel launch over all CPU cores, or one on CUDA.

Warp runs a CPU launch serially on the calling thread but lets go of the interpreter lock, so a range
split over threads runs at the same time. A kernel of the hot path therefore begins with the arguments
`first, end, slab`: it works on [first, end) and adds only into its own slab of an accumulator, which
keeps results free of races and, on the CPU, equal to the last bit from run to run. Our own, as Warp has no
launch over several CPU threads: two of them took 9.9 ms where its launch took 19.2.
"""

from __future__ import annotations

import ctypes
import math
import os
import threading
import weakref
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from warp_trunk.errors import InputError
from warp_trunk.kernels.synchronization import BARRIER_SIZE, barrier_kernel, copy_to_host_kernel

Launch = Callable[[], None]
"""A recorded launch, to call many times."""
LEAST_SPLIT = 4096
"""Fewer items than this are run by the calling thread alone: waking another takes longer."""
CUDA_BLOCK = 256
"""Threads of most CUDA blocks; launches are padded to whole blocks because sums are reduced per block."""


def choose_device(name: str) -> str:
    """The Warp device for `auto`, `cpu` or `cuda:N`; InputError where it does not exist."""
    wp.init()
    if name == "auto":
        return "cuda:0" if wp.is_cuda_available() else "cpu"
    known = [str(device) for device in wp.get_devices()]
    if name not in known:
        raise InputError(f"device: '{name}' is not on this machine; choose auto or one of {', '.join(known)}")
    return name


MOST_THREADS = 1024
"""More would only wait for each other."""


def choose_threads(threads: int) -> int:
    """The asked number of CPU threads, or for 0 the number of cores this process may use."""
    if not 0 <= threads <= MOST_THREADS:
        raise InputError(f"threads: must be 0 (all cores) to {MOST_THREADS}, not {threads}")
    return threads or len(os.sched_getaffinity(0))


class Parallel:
    """Where launches run: `ranges` threads of the CPU, or a CUDA device (one range).

    Launches of fewer items than `least_split` run on the calling thread alone.
    """

    def __init__(self, device: str = "auto", threads: int = 0, *, least_split: int = LEAST_SPLIT) -> None:
        self.device = choose_device(device)
        self.least_split = least_split
        self.is_cuda = self.device.startswith("cuda")
        self.ranges = 1 if self.is_cuda else choose_threads(threads)
        self._captured: int | None = None
        """The range whose launches are captured at the moment, if any are."""
        self._splits = self._seen_split = False
        """Whether the ranges that are captured wait for each other, and whether a launch is seen that splits."""
        self._barrier: Launch | None = None
        self._workers = [_Worker() for _ in range(self.ranges - 1)]

    def split(self, size: int) -> np.ndarray:
        """Bounds of equal ranges of [0, size), shape (ranges + 1,)."""
        return np.linspace(0, size, self.ranges + 1).astype(np.int64)

    def record(
        self,
        kernel: Any,
        size: int | np.ndarray,
        inputs: Sequence[Any],
        outputs: Sequence[Any],
        least: int | None = None,
        *,
        loops: bool = False,
        block: int = CUDA_BLOCK,
    ) -> Launch:
        """A launch of `kernel(first, end, slab, *inputs, *outputs)` to call many times.

        `size` is the number of items, or the bounds of the ranges where they should not be equal. Fewer
        items than `least` are not split; `least_split` where it is left out. A kernel that `loops` over a range
        itself, on the CPU, is launched once for each. `block` is the number of threads of a CUDA block.
        """
        bounds = self.split(size) if isinstance(size, int) else size
        if bounds[-1] < (self.least_split if least is None else least):
            bounds = bounds[[0, -1]]
        commands = []
        for slab, (first, end) in enumerate(pairwise(bounds)):
            count = int(end - first)
            if count == 0:
                continue
            if loops:
                count = 1
            elif self.is_cuda:
                count = -(-count // block) * block
            commands.append(
                wp.launch(
                    kernel,
                    dim=count,
                    inputs=[int(first), int(end), slab, *inputs],
                    outputs=list(outputs),
                    device=self.device,
                    block_dim=block,
                    record_cmd=True,
                )
            )
        if not commands:
            return lambda: None
        return self._over_ranges([command.launch for command in commands])

    def _over_ranges(self, parts: Sequence[Launch]) -> Launch:
        """A launch of a part for each range; while a range is captured, of its part alone."""
        if self.is_cuda:
            return parts[0]
        own, *others = parts
        pairs = list(zip(self._workers, others, strict=False))

        def launch() -> None:
            if self._captured is not None:
                self._capture_part(parts)
                return
            for worker, part in pairs:
                worker.begin(part)
            own()
            for worker, _ in pairs:
                worker.finish()

        return launch

    def _capture_part(self, parts: Sequence[Launch]) -> None:
        """Captures the part of the range that is captured."""
        assert self._captured is not None
        if self._captured < len(parts):
            parts[self._captured]()
        if self._splits:
            assert self._barrier is not None
            self._barrier()
        self._seen_split = self._seen_split or len(parts) > 1

    def once(self, action: Launch) -> Launch:
        """Work of one thread for all, such as clearing an array, as a launch that can be captured."""
        return self._over_ranges([action])

    def capture(self, work: Launch) -> Launch:
        """All that `work` launches as one launch, which the host takes no part in.

        On the CPU every thread runs its part of one launch after the other, and the threads wait for each other
        where that ends, which takes less than to start and end them each time. `work` launches what was recorded
        here, nothing else: what does not split is done by each thread.
        """
        if self._barrier is None:  # recorded first: a launch that is recorded while capturing would be captured
            self._barrier = self._record_barrier()
        with _CAPTURING:
            self._splits, self._seen_split = self.ranges > 1, False
            graphs = [self._capture_range(work, None if self.is_cuda else 0)]
            if self._seen_split:
                graphs += [self._capture_range(work, slab) for slab in range(1, self.ranges)]
            elif self._splits:  # without effect: one thread does all, and waits for none
                self._splits = False
                graphs = [self._capture_range(work, 0)]
        return self._over_ranges([partial(_replay, graph, work) for graph in graphs])

    def graph(self, *launches: Launch) -> Launch:
        """Several launches as one: on CUDA a graph, which the host launches in the time of one kernel."""
        work = in_sequence(*launches)
        return self.capture(work) if self.is_cuda else work

    def _capture_range(self, work: Launch, slab: int | None) -> Any:
        """The work of one range; the ranges wait for each other where a launch splits."""
        self._captured = slab
        wp.capture_begin(self.device)
        try:
            work()
        finally:
            self._captured = None
            graph = wp.capture_end(self.device)
        return graph

    def _record_barrier(self) -> Launch:
        """A launch that waits, in a captured range, for the other ranges."""
        if self.ranges == 1:
            return lambda: None
        barrier = wp.zeros(BARRIER_SIZE, dtype=wp.int32, device=self.device)
        give_way = ctypes.cast(ctypes.CDLL(None).sched_yield, ctypes.c_void_p).value
        return self._one_command(barrier_kernel, 1, [barrier, self.ranges, give_way], [])

    def wait(self) -> None:
        """Waits until all that this thread has launched is done."""
        if self.is_cuda:
            wp.synchronize_stream(self.device)

    def record_undivided(self, kernel: Any, size: int, inputs: Sequence[Any], outputs: Sequence[Any]) -> Launch:
        """A launch of `kernel(*inputs, *outputs)` that is not split: the few items are not worth a thread."""
        return self.once(self._one_command(kernel, size, inputs, outputs))

    def _one_command(self, kernel: Any, size: int, inputs: Sequence[Any], outputs: Sequence[Any]) -> Launch:
        command = wp.launch(
            kernel, dim=size, inputs=list(inputs), outputs=list(outputs), device=self.device, record_cmd=True
        )
        return command.launch  # pyright: ignore[reportOptionalMemberAccess]  (recorded launches are returned)


def _replay(graph: wp.Graph, held: Launch) -> None:
    """Launches a graph. It holds what was captured: a graph does not hold the arrays of its launches."""
    wp.capture_launch(graph)


_CAPTURING = threading.Lock()
"""Warp captures for one thread of the process at a time."""


def in_sequence(*launches: Launch) -> Launch:
    """Several launches as one, in their order."""

    def launch() -> None:
        for each in launches:
            each()

    return launch


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

    def __init__(self, parallel: Parallel, array: wp.array) -> None:
        """For an array, shape (...), whose numbers of float64 are few."""
        self._parallel = parallel
        self.send: Launch = lambda: None
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


class _Worker:
    """A thread that runs one launch at a time, woken by a lock: a third of a thread pool's delay."""

    def __init__(self) -> None:
        self._work: Callable[[], None] | None = None
        self._error: BaseException | None = None
        self._wake, self._done = threading.Lock(), threading.Lock()
        self._wake.acquire()
        self._done.acquire()
        self._thread = threading.Thread(target=_serve, args=(weakref.ref(self), self._wake), daemon=True)
        self._thread.start()
        weakref.finalize(self, self._wake.release)

    def begin(self, work: Callable[[], None]) -> None:
        """Runs `work` on the thread; `finish` waits for it."""
        self._work = work
        self._wake.release()

    def finish(self) -> None:
        """Waits for the work, and raises what it raised."""
        self._done.acquire()
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def run(self) -> None:
        """The work of the thread after it is woken."""
        try:
            assert self._work is not None
            self._work()
        except BaseException as error:
            self._error = error
        self._done.release()


def _serve(worker: weakref.ref[_Worker], wake: threading.Lock) -> None:
    """Runs the work of a worker until the worker is released."""
    while wake.acquire():
        alive = worker()
        if alive is None:
            return
        alive.run()
        del alive
