"""A team of threads: how it is woken, what interrupts its start, and how it ends."""

# Warp's annotations are values:
# pyright: reportInvalidTypeForm=false

from __future__ import annotations

import gc
import platform
import sys
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest
import warp as wp

from warp_trunk.engine.parallel import Parallel
from warp_trunk.engine.waking import FUTEX, VARIABLE, waking_way
from warp_trunk.errors import InputError

WAYS = ["futex", "locks"] if waking_way() == "futex" else ["locks"]
SIZE = 1000


def clearing(threads: int) -> Callable[[], bool]:
    """A call that has a new team clear an array, and says whether it has."""
    parallel = Parallel("cpu", threads, least_split=1)
    values = wp.full(SIZE, 7, dtype=wp.int8, device="cpu")
    launch = parallel.clear(values)

    def clears() -> bool:
        values.fill_(7)
        launch()
        return not values.numpy().any()

    return clears


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("threads", [2, 5])
def test_sleeping_threads_are_woken(way: str, threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """After any pause: they spin for some 0.1 ms, and then go to sleep at any moment of the next launch."""
    monkeypatch.setenv(VARIABLE, way)
    clears = clearing(threads)
    pauses = np.random.default_rng(threads).uniform(0.0, 5e-4, 200)
    pauses[:2] = 0.05
    for pause in pauses:
        time.sleep(pause)
        assert clears()


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("started", [False, True])
@pytest.mark.parametrize("cause", [KeyboardInterrupt, RuntimeError])
def test_a_start_that_is_cut_off_goes_on_with_the_next_launch_or_ends(
    way: str, started: bool, cause: type[BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It left a team that never stopped waiting for threads that were not started."""
    monkeypatch.setenv(VARIABLE, way)
    real, starts, allowed = threading.Thread.start, [], 1

    def start(thread: threading.Thread) -> None:
        starts.append(thread)
        if len(starts) > allowed:
            if started and len(starts) == 2:
                real(thread)
            raise cause("can't start new thread")
        real(thread)

    gc.collect()
    before = threading.active_count()
    monkeypatch.setattr(threading.Thread, "start", start)
    for whole in (True, False):
        starts.clear()
        allowed = 1
        clears = clearing(4)
        with pytest.raises((KeyboardInterrupt, InputError), match="thread") as error:
            clears()
        line = str(error.value)
        assert cause is KeyboardInterrupt or ("starts no more than" in line and "ask for fewer" in line)
        allowed = 9
        assert not whole or (clears() and clears())
        del clears, error
        gc.collect()
        assert threading.active_count() == before


@pytest.mark.parametrize(
    ("system", "machine", "way"),
    [
        ("linux", "x86_64", "futex"),
        ("linux", "riscv64", "locks"),
        ("darwin", "arm64", "locks"),
    ],
)
def test_the_way_of_each_system(system: str, machine: str, way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setattr(platform, "machine", lambda: machine)
    assert waking_way() == way
    assert FUTEX == {"x86_64": 202, "aarch64": 98}  # asm/unistd_64.h and asm-generic/unistd.h of the kernel
    monkeypatch.setenv(VARIABLE, "locks")
    assert waking_way() == "locks"
    monkeypatch.setenv(VARIABLE, "signals")
    with pytest.raises(InputError, match=rf"{VARIABLE}: must be .*locks.*, not 'signals'"):
        Parallel("cpu", 2)
