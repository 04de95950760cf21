"""Launches of kernels over all CPU cores, or on CUDA.

Warp runs a CPU launch on the calling thread alone. Here the range of a launch is split over threads, and launches
that follow each other are one program, which a team of threads runs in one call of machine code (see the kernels
of `synchronization`): the threads are woken once instead of for each launch, and Ctrl-C comes before or after a
program, never in between. A kernel of the hot path takes `Items` first: it works on a range and adds only into its
own slab of an accumulator, which keeps results free of races and, on the CPU, equal to the last bit from run to
run.
"""

from __future__ import annotations

import ctypes
import math
import os
import threading
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial, wraps
from itertools import pairwise
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np
import warp as wp

from warp_trunk.errors import InputError
from warp_trunk.kernels.arguments import Items, filled
from warp_trunk.kernels.native import NativeKernel
from warp_trunk.kernels.starting import start_warp
from warp_trunk.kernels.synchronization import (
    BOARD_SIZE,
    call_kernel,
    clear_kernel,
    copy_to_host_kernel,
    serve_kernel,
)
from warp_trunk.kernels.vectors import slab_gatherer

Launch = Callable[[], None]
"""A recorded launch, to call many times."""
LEAST_SPLIT = 4096
"""Fewer items than this are run by the calling thread alone: to wait for another takes longer."""
CUDA_BLOCK = 256
"""Threads of most CUDA blocks; launches are padded to whole blocks because sums are reduced per block."""
ENGINE = threading.RLock()
"""Held while a model or relaxer is made and while one relaxes: the threads of a process take turns, because Warp
captures for CUDA whatever another thread launches meanwhile, and compiles a kernel for one thread at a time."""


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
    return threads or usable_cores()


GROUPS = Path("/proc/self/cgroup")
"""The control groups of this process."""
ROOT = Path("/sys/fs/cgroup")
"""Where control groups are mounted."""


def usable_cores() -> int:
    """The cores that this process may run on, at most the quota of its container in whole cores, at least one."""
    return max(1, math.ceil(min(len(os.sched_getaffinity(0)), quota(GROUPS, ROOT))))


def quota(groups: Path, root: Path) -> float:
    """The least quota of the control groups of a process and those above them, in cores; infinite where none is.

    Args:
        groups: the file of its groups, lines `number:controllers:path`; version 2 has one without controllers.
        root: where the groups are mounted; inside a container that is often the process's own group.
    """
    try:
        lines = [line.split(":", 2) for line in groups.read_text().splitlines()]
    except OSError:
        return math.inf
    least = math.inf
    for _, controllers, path in (line for line in lines if len(line) == 3):
        if controllers == "":
            mount, names = root, ("cpu.max",)
        elif "cpu" in controllers.split(","):
            mount, names = root / controllers, ("cpu.cfs_quota_us", "cpu.cfs_period_us")
            mount = mount if mount.is_dir() else root / "cpu"
        else:
            continue
        inside = mount / path.strip("/")
        for folder in (inside, *inside.parents):
            least = min(least, _quota_of(folder, names))
            if folder == mount:
                break
    return least


def _quota_of(folder: Path, names: tuple[str, ...]) -> float:
    """The quota of one group, in cores."""
    try:
        allowed, period = map(float, " ".join((folder / name).read_text() for name in names).split())
    except (OSError, ValueError):  # no such group, or `max`
        return math.inf
    return allowed / period if allowed > 0.0 and period > 0.0 else math.inf


class Parallel:
    """Where launches run: `ranges` threads of the CPU, or a CUDA device (one range).

    Launches of fewer items than `least_split` run on the calling thread alone.
    """

    def __init__(self, device: str = "auto", threads: int = 0, *, least_split: int = LEAST_SPLIT) -> None:
        self.device = choose_device(device)
        self.least_split = least_split
        self.is_cuda = self.device.startswith("cuda")
        self.ranges = 1 if self.is_cuda else choose_threads(threads)
        self._team = _Team(self.ranges)

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
            given = [filled(Items, first=first, end=end, slab=slab), *inputs, *outputs]
            commands.append(
                wp.launch(kernel, dim, given, device=self.device, block_dim=block, record_cmd=True)
                if first < end
                else None
            )
        if self.is_cuda:
            return commands[0].launch if any(commands) else nothing
        return _Recorded(self._team, [_Step(tuple(commands))] if any(commands) else [])

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
        given = [self.ranges, size, view(slabs, scalar, self.ranges * size)]
        return self.record(slab_gatherer(scalar), size, given, [])

    def repeat(self, running: wp.array, work: Launch) -> Launch:
        """A launch of recorded work, once and again as long as the first number of `running` is not 0 after it.

        On CUDA it is not launched at all where that is 0 before it.
        """
        if self.is_cuda:
            return lambda: wp.capture_while(running, work)
        assert isinstance(work, _Recorded)
        *steps, last = work.steps
        return _Recorded(self._team, [*steps, _Step(last.commands, running, len(steps))])

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


def beside(launch: Launch, other: Launch) -> Launch:
    """Two launches on the CPU of which neither reads or writes what the other writes: no thread waits between."""
    if isinstance(launch, _Recorded):
        launch = _Recorded(launch.team, [replace(step, meets=False) for step in launch.steps])
    return in_sequence(launch, other)


@dataclass(frozen=True, eq=False)
class _Step:
    """A launch that is part of a program."""

    commands: tuple[Any, ...]
    """The launch of each range that Warp has recorded, or None; those at the end may be left out."""
    running: wp.array | None = None
    """Where its first number is not 0 after the step, the program goes back."""
    back: int = 0
    """By so many steps."""
    meets: bool = True
    """Whether the threads wait for each other before the next step."""

    @property
    def split(self) -> bool:
        """Whether another range than the first has a part in it."""
        return any(self.commands[1:])


class _Recorded:
    """Steps on the CPU, as a launch; they become a program when they are first launched."""

    def __init__(self, team: _Team, steps: Sequence[_Step]) -> None:
        self.team, self.steps = team, steps
        self._call: Launch | None = None

    def __call__(self) -> None:
        """Runs the steps."""
        if not self.steps:
            return
        if self._call is None:
            self._call = self.team.program(self.steps)
        self._call()


class _Team:
    """The CPU threads that run the ranges of a program; they are started when one is split."""

    def __init__(self, ranges: int) -> None:
        self.ranges = ranges
        self._lock = threading.Lock()
        self._board: wp.array | None = None
        self._process = 0
        """The process whose threads they are, 0 for none."""

    def program(self, steps: Sequence[_Step]) -> Launch:
        """The steps as a launch: one call of machine code, which Ctrl-C or another thread cannot come between."""
        split = any(step.split for step in steps)
        threads = self.ranges if split else 1
        table = np.zeros((len(steps), 3 + 3 * threads), dtype=np.int64)
        held: list[Any] = [table, steps]
        for number, step in enumerate(steps):
            # not after the last step, as the caller waits for all, nor between two that are the first range's
            following = steps[number + 1 : number + 2]
            apart = not step.meets or not (following and (step.split or following[0].split))
            table[number, 0] = split and (step.running is not None or not apart)
            if step.running is not None:
                table[number, 1:3] = np.array([step.running.ptr, number - step.back])
            for slab, command in enumerate(step.commands):
                if command is not None:
                    call = _Call(command)
                    table[number, 3 + 3 * slab : 6 + 3 * slab] = call.addresses
                    held.append(call)
        return self._caller(threads, table.ctypes.data, len(steps), held)

    def _caller(self, threads: int, table: int, steps: int, held: Any) -> Launch:
        """A launch of `call_kernel`."""
        call = _Call(self._command(call_kernel, 0, [threads, _system_call(), table, steps]))

        def launch(held: Any = held) -> None:
            if threads == 1:
                call()
                return
            with self._lock:
                self._start()
                call()

        return launch

    def _command(self, kernel: Any, range: int, arguments: Sequence[Any]) -> Any:
        if self._board is None:
            self._board = wp.zeros(BOARD_SIZE, dtype=wp.int64, device="cpu")
        given = [filled(Items, slab=range), self._board, *arguments]
        return wp.launch(kernel, dim=1, inputs=given, device="cpu", record_cmd=True)

    def _start(self) -> None:
        """Starts the threads, once; InputError in a process that was forked from theirs."""
        if self._process == os.getpid():
            return
        if self._process:
            raise InputError(
                "threads: this process was forked from one whose threads relax tissue, and has none of them; "
                "make the model in this process, or start it with the method 'spawn'"
            )
        self._process = os.getpid()
        calls = [
            _Call(self._command(serve_kernel, r, [self.ranges, _system_call()])) for r in range(1, self.ranges)
        ]
        threads = [threading.Thread(target=call, daemon=True) for call in calls]
        for thread in threads:
            thread.start()
        end = _Call(self._command(call_kernel, 0, [self.ranges, _system_call(), 0, -1]))
        weakref.finalize(self, _end, self._process, end, threads)


def _end(process: int, end: Launch, threads: Sequence[threading.Thread]) -> None:
    """Ends the threads of a team."""
    if process == os.getpid():
        end()
        for thread in threads:
            thread.join()


class _Call:
    """A call of the machine code of a launch that Warp has recorded, with its bounds and arguments."""

    def __init__(self, command: Any) -> None:
        bounds, *values = command.params
        arguments = _arguments_type(*map(type, values))(*values)
        self._held = command, arguments
        self._function, self._given = command.hooks.forward, (ctypes.byref(bounds), ctypes.byref(arguments))
        function = ctypes.cast(self._function, ctypes.c_void_p).value
        self.addresses = np.array([function, ctypes.addressof(bounds), ctypes.addressof(arguments)])

    def __call__(self) -> None:
        """Calls it without the interpreter lock."""
        self._function(*self._given)


@cache
def _arguments_type(*types: Any) -> Any:
    """The arguments of a kernel as its machine code has them."""
    fields = [(f"argument{number}", kind) for number, kind in enumerate(types)]
    return type("Arguments", (ctypes.Structure,), {"_fields_": fields})


@cache
def _system_call() -> int:
    """The address of the function for calls of the operating system."""
    address = ctypes.cast(ctypes.CDLL(None).syscall, ctypes.c_void_p).value
    assert address is not None
    return address


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
