"""How the threads of a team sleep and are woken: the one part of it that depends on the operating system.

On Linux they sleep in the system call `futex`, and one call wakes them all. Everywhere else each sleeps in a lock
of Python, whose functions are part of its stable binary interface and need no interpreter lock. Inside a program
threads spin in both ways (see the kernels of `synchronization`), so that the way changes no number.
"""

from __future__ import annotations

import ctypes
import os
import platform
import sys
from collections.abc import Sequence
from typing import Any

from warp_trunk.errors import InputError

VARIABLE = "WARP_TRUNK_WAKING"
"""The environment variable that forces a way."""
FUTEX = {"x86_64": 202, "aarch64": 98}
"""The number of the system call `futex` of Linux, by architecture."""
FUTEX_WAY, LOCKS_WAY = "futex", "locks"


def waking_way() -> str:
    """The way of this process: `futex` or `locks`; InputError where `WARP_TRUNK_WAKING` asks for another."""
    has_futex = sys.platform == "linux" and platform.machine() in FUTEX
    ways = [FUTEX_WAY, LOCKS_WAY] if has_futex else [LOCKS_WAY]
    way = os.environ.get(VARIABLE) or ways[0]
    if way not in ways:
        raise InputError(f"{VARIABLE}: must be {' or '.join(ways)} on this system, not '{way}'")
    return way


def system_functions(way: str) -> list[int]:
    """Addresses of what gives the core up and of `syscall`, the number of `futex`, addresses of what acquires and
    releases a lock of Python; 0 for what the way or the system does without."""
    if way == FUTEX_WAY:
        return [_give_core_up(), _address(ctypes.CDLL(None).syscall), FUTEX[platform.machine()], 0, 0]
    python = ctypes.pythonapi
    return [_give_core_up(), 0, 0, _address(python.PyThread_acquire_lock), _address(python.PyThread_release_lock)]


def _give_core_up() -> int:
    """The function that lets another thread have this core, which takes no argument; 0 where it is not known."""
    try:
        if sys.platform == "win32":
            return _address(ctypes.WinDLL("kernel32").SwitchToThread)
        return _address(ctypes.CDLL(None).sched_yield)
    except (AttributeError, OSError):
        return 0


def _address(function: Any) -> int:
    address = ctypes.cast(function, ctypes.c_void_p).value
    assert address is not None
    return address


def make_locks(way: str, count: int) -> list[int]:
    """The addresses of locks in which threads sleep, each taken; none for the way of `futex`."""
    if way == FUTEX_WAY:
        return []
    allocate, acquire = ctypes.pythonapi.PyThread_allocate_lock, ctypes.pythonapi.PyThread_acquire_lock
    allocate.restype, acquire.argtypes = ctypes.c_void_p, [ctypes.c_void_p, ctypes.c_int]
    locks: list[int] = []
    for _ in range(count):
        lock = allocate()
        if lock is None:
            raise MemoryError("no lock for a thread")
        acquire(lock, 0)
        locks.append(lock)
    return locks


def free_locks(locks: Sequence[int]) -> None:
    """Frees locks in which no thread sleeps."""
    for lock in locks:
        ctypes.pythonapi.PyThread_free_lock(ctypes.c_void_p(lock))
