"""What other programs took of the machine while something was measured."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass

import psutil

BUSY = 0.1
"""From so many cores on, other programs are told of: two peers that differ by less are not told apart anyway."""


@dataclass(frozen=True)
class Taken:
    """Time taken so far, each from a beginning of its own [s]."""

    clock: float
    """By the clock."""
    machine: float
    """By all programs on all cores."""
    own: float
    """By this program and those that it started and that have ended."""


def taken() -> Taken:
    """As it is now."""
    used = psutil.cpu_times()
    return Taken(time.perf_counter(), used.user + used.nice + used.system, sum(os.times()[:4]))


def cores_of_others(before: Taken, after: Taken) -> float:
    """How many cores other programs kept busy meanwhile, on average."""
    others = (after.machine - before.machine) - (after.own - before.own)
    return max(0.0, others) / (after.clock - before.clock)
