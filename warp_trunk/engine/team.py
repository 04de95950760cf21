"""The CPU threads that run recorded launches together.

Launches that follow each other are one program, which a team of threads runs in one call of machine code: the
threads are woken once instead of for each launch, and Ctrl-C comes before or after a program, never in between.
"""

from __future__ import annotations

import ctypes
import os
import threading
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import warp as wp

from warp_trunk.errors import InputError
from warp_trunk.kernels.arguments import Items, filled
from warp_trunk.kernels.synchronization import LINE, SLEEPERS, SYSTEM, board_size, call_kernel, serve_kernel

from .waking import free_locks, make_locks, system_functions, waking_way


@dataclass(frozen=True, eq=False)
class Step:
    """A launch that is part of a program."""

    commands: tuple[Any, ...]
    """The launch of each range that Warp has recorded, or None; those at the end may be left out."""
    running: wp.array | None = None
    """Where its first number is not 0 after the step, the program goes back."""
    back: int = 0
    """By so many steps."""

    @property
    def split(self) -> bool:
        """Whether another range than the first has a part in it."""
        return any(self.commands[1:])


class Team:
    """The CPU threads that run the ranges of a program; they are started when one is split."""

    def __init__(self, ranges: int) -> None:
        self.ranges = ranges
        self.way = waking_way()
        """How its threads are woken."""
        self._board: wp.array | None = None
        self._process = 0
        """The process whose threads they are, 0 for none."""
        self._unserved: list[_Call] = []
        """Calls that serve the ranges for which no thread runs yet; each thread takes one."""
        self._threads: list[threading.Thread] = []

    def program(self, steps: Sequence[Step]) -> Callable[[], None]:
        """The steps as a launch: one call of machine code, which Ctrl-C or another thread cannot come between.

        Whoever launches it holds `ENGINE`. It raises InputError where the system does not start the threads, and
        can be launched again.
        """
        split = any(step.split for step in steps)
        threads = self.ranges if split else 1
        table = np.zeros((len(steps), 3 + 3 * threads), dtype=np.int64)
        held: list[Any] = [table, steps]
        for number, step in enumerate(steps):
            # not after the last step, as the caller waits for all, nor between two that are the first range's
            following = steps[number + 1 : number + 2]
            together = following and (step.split or following[0].split)
            table[number, 0] = split and (step.running is not None or bool(together))
            if step.running is not None:
                table[number, 1:3] = np.array([step.running.ptr, number - step.back])
            for slab, command in enumerate(step.commands):
                if command is not None:
                    call = _Call(command)
                    table[number, 3 + 3 * slab : 6 + 3 * slab] = call.addresses
                    held.append(call)
        run = self._call(call_kernel, 0, [threads, table.ctypes.data, len(steps)])

        def launch(held: Any = held) -> None:
            if split:
                self._start()
            run()

        return launch

    def _call(self, kernel: Any, range: int, arguments: Sequence[Any]) -> _Call:
        if self._board is None:
            self._board = wp.zeros(board_size(self.ranges), dtype=wp.int64, device="cpu")
            self._board.numpy()[SYSTEM : SYSTEM + 5] = system_functions(self.way)
        inputs = [filled(Items, slab=range), self._board, *arguments]
        return _Call(wp.launch(kernel, dim=1, inputs=inputs, device="cpu", record_cmd=True))

    def _start(self) -> None:
        """Starts the threads that do not run yet; InputError in a process that was forked from theirs.

        Ctrl-C may come anywhere in between, and the system may refuse a thread: those that run keep their ranges,
        and the next call starts the others. A thread too many finds no range and ends.
        """
        if self._process != os.getpid():
            self._prepare()
        missing = len(self._unserved)
        for number in range(missing):
            thread = threading.Thread(target=_serve, args=(self._unserved, self._board), daemon=True)
            self._threads.append(thread)
            try:
                thread.start()
            except (RuntimeError, MemoryError) as error:
                running = self.ranges - missing + number
                raise InputError(
                    f"threads: the system starts no more than {running} of {self.ranges} threads ({error}); "
                    "ask for fewer, or raise its limit on memory or processes"
                ) from error

    def _prepare(self) -> None:
        """Makes the calls that serve the ranges but the first, and those that end their threads with the team."""
        if self._process:
            raise InputError(
                "threads: this process was forked from one whose threads relax tissue, and has none of them; "
                "make the model in this process, or start it with the method 'spawn'"
            )
        unserved = [self._call(serve_kernel, r, [self.ranges]) for r in range(1, self.ranges)]
        ends = [self._call(call_kernel, 0, [1 + serving, 0, -1]) for serving in range(self.ranges)]
        locks = make_locks(self.way, self.ranges - 1)
        assert self._board is not None
        for number, lock in enumerate(locks):
            self._board.numpy()[SLEEPERS + LINE * number + 1] = lock
        weakref.finalize(self, _end, os.getpid(), self._board, self._threads, unserved, ends, locks)
        self._unserved = unserved
        self._process = os.getpid()


def _serve(unserved: list[_Call], board: wp.array) -> None:
    """Runs one of the ranges that no thread has, until the team ends; nothing where each has its thread."""
    try:
        serve = unserved.pop(0)  # so that the ranges that have a thread are the first, as `_end` takes them to be
    except IndexError:
        return
    serve()


def _end(
    process: int,
    board: wp.array,
    threads: Sequence[threading.Thread],
    unserved: list[_Call],
    ends: Sequence[_Call],
    locks: Sequence[int],
) -> None:
    """Ends the threads of a team; one that starts only now finds no range."""
    if process != os.getpid():
        return
    serving = len(ends) - 1
    while unserved:
        try:
            unserved.pop()
        except IndexError:
            break
        serving -= 1
    ends[serving]()
    for thread in threads:
        if thread.is_alive():
            thread.join()
    free_locks(locks)


class _Call:
    """A call of the machine code of a launch that Warp has recorded, with its bounds and arguments."""

    def __init__(self, command: Any) -> None:
        bounds, *values = command.params
        arguments = _arguments_type(*map(type, values))(*values)
        self._held = command, arguments
        self._function, self._arguments = command.hooks.forward, (ctypes.byref(bounds), ctypes.byref(arguments))
        function = ctypes.cast(self._function, ctypes.c_void_p).value
        self.addresses = np.array([function, ctypes.addressof(bounds), ctypes.addressof(arguments)])

    def __call__(self) -> None:
        """Calls it without the interpreter lock."""
        self._function(*self._arguments)


@cache
def _arguments_type(*types: Any) -> Any:
    """The arguments of a kernel as its machine code has them."""
    fields = [(f"argument{number}", kind) for number, kind in enumerate(types)]
    return type("Arguments", (ctypes.Structure,), {"_fields_": fields})
