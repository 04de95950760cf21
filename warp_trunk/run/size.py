"""Memory and time that a number of tetrahedra takes, estimated before any work."""

from __future__ import annotations

import os
from pathlib import Path

from warp_trunk.errors import InputError

LARGE = 1_000_000
"""From this number of tetrahedra on, memory and time are shown, and the stages of meshing."""
_MEMORY, _MEMORY_EACH = 0.5e9, 1000.0
"""Bytes of a run, and of each tetrahedron: 0.68, 1.07 and 1.75 GB with 0.22, 1.0 and 1.9 million, without TetGen's
process, which has as much and ends before the model is made."""
_SECONDS_EACH = 3.5e-4
"""Seconds for each tetrahedron on two cores: 70, 512 and 597 with the same numbers, beside other work."""
_GROUPS = Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory/memory.limit_in_bytes")
"""Files with the limit of a container."""


def check_size(tets: int, *, go_on: bool = False) -> str | None:
    """A sentence on memory and time where the number of tetrahedra is large.

    Raises:
        InputError: it needs more memory than this machine has, and `go_on` is not set.
    """
    need, minutes, there = _MEMORY + _MEMORY_EACH * tets, _SECONDS_EACH * tets / 60.0, memory_here()
    cost = f"{tets} tetrahedra need about {need / 1e9:.1f} GB of memory and {minutes:.0f} min on two cores"
    if need > there and not go_on:
        few = max(int((there - _MEMORY) / _MEMORY_EACH), 0)
        raise InputError(f"tets: {cost}, this machine has {there / 1e9:.1f} GB; ask for {few}, or give --yes")
    return cost if tets >= LARGE else None


def memory_here() -> float:
    """Memory of this machine, or of the container that it is [bytes]; infinite where it is not known."""
    limits = [float("inf")]
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        limits.append(float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE"))
    for path in _GROUPS:
        try:
            limits.append(float(path.read_text()))
        except (OSError, ValueError):  # no such group, or `max`
            continue
    return min(limits)
