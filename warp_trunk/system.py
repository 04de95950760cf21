"""The operating system: only this file and `engine.waking` ask which one it is.

Each function has a fallback for systems without what it uses.
"""

from __future__ import annotations

import math
import os
import sys
from pathlib import Path

GROUPS = Path("/proc/self/cgroup")
"""The control groups of this process."""
ROOT = Path("/sys/fs/cgroup")
"""Where control groups are mounted."""


def usable_cores() -> int:
    """The cores that this process may run on, at most the quota of its container in whole cores, at least one."""
    if sys.platform == "linux":
        cores = len(os.sched_getaffinity(0))
    else:
        cores = os.cpu_count() or 1
    return max(1, math.ceil(min(cores, quota(GROUPS, ROOT))))


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
