"""The operating system: only this file and `engine.waking` ask which one it is.

Each function has a fallback for systems without what it uses. Imports no other part of the program.
"""

from __future__ import annotations

import ctypes
import math
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import subprocess

DISK_FULL = 74
"""The exit status of a child process that could not write its result: EX_IOERR, which Windows does not name."""
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
        lines = [line.split(":", 2) for line in groups.read_text(encoding="utf-8").splitlines()]
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
        texts = [(folder / name).read_text(encoding="utf-8") for name in names]
        allowed, period = map(float, " ".join(texts).split())
    except (OSError, ValueError):  # no such group, or `max`
        return math.inf
    return allowed / period if allowed > 0.0 and period > 0.0 else math.inf


_MEMORY_LIMITS = ROOT / "memory.max", ROOT / "memory" / "memory.limit_in_bytes"
"""Files with the limit of a container, of version 2 and 1."""


def usable_memory() -> float:
    """Memory of this machine, or of the container that it is [bytes]."""
    import psutil

    limits = [float(psutil.virtual_memory().total)]
    for path in _MEMORY_LIMITS:
        try:
            limits.append(float(path.read_text(encoding="utf-8")))
        except (OSError, ValueError):  # no such group, or `max`
            continue
    return min(limits)


def peak_memory(*, children: bool = True) -> float:
    """Largest resident memory of this process or one of its children so far [MB]; on Windows without children.

    Alone on Linux, it does not count what its parent held when it was started, as otherwise.
    """
    if sys.platform == "win32":
        import psutil

        return psutil.Process().memory_info().peak_wset / 1e6
    if sys.platform == "linux" and not children:
        status = Path("/proc/self/status").read_text(encoding="utf-8")
        return (
            next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM:")) * 1024.0 / 1e6
        )
    import resource

    unit = 1.0 if sys.platform == "darwin" else 1024.0
    own, of_children = (resource.getrusage(w).ru_maxrss for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return max(own, of_children if children else 0) * unit / 1e6


def kernel_cache() -> Path | None:
    """Where Warp keeps compiled kernels in the user's home; None on Windows, where users have a folder of data."""
    if sys.platform == "win32":
        return None
    return Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "warp"


_LIMIT = threading.Lock()


@contextmanager
def limited_memory(size: int) -> Iterator[None]:
    """Lets a library that reads a file of `size` bytes have 2 GiB and 60 times that, then raises MemoryError.

    Libraries make room for what a header says, which in a damaged file may be a thousand times the machine's
    memory. Only Linux can report and enforce the limit; elsewhere nothing is limited.
    """
    if sys.platform != "linux":
        yield
        return
    import resource

    with _LIMIT:  # one at a time, so that each finds the limit as it was
        soft, hard = resource.getrlimit(resource.RLIMIT_AS)
        pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[0])
        most = pages * resource.getpagesize() + 2**31 + 60 * size
        resource.setrlimit(resource.RLIMIT_AS, (most if soft == resource.RLIM_INFINITY else min(most, soft), hard))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def end_with_parent() -> None:
    """Has Linux end this child process with its parent, however that ends; elsewhere it works to its end.

    Raises:
        SystemExit: the parent has ended already.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
        if os.getppid() == 1:
            sys.exit("the program that started it has ended")


def ending_of(status: int) -> str:
    """How a child process ended whose exit status is not 0, as the end of a sentence.

    A signal has a negative number; on Windows an exception of the processor has the highest bits.
    """
    if status < 0:
        return f"was ended by signal {-status}"
    if status >= 0xC0000000:
        return f"was ended by exception 0x{status:X}"
    return f"ended with status {status}"


def start_apart(command: Sequence[str], environment: dict[str, str], output: Any) -> subprocess.Popen[bytes]:
    """Starts a program without input that Ctrl-C in this terminal does not end; its words go to the output."""
    import subprocess

    group = subprocess.CREATE_NEW_PROCESS_GROUP if sys.platform == "win32" else 0
    return subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=output,
        env=environment,
        start_new_session=True,
        creationflags=group,
    )


@contextmanager
def interrupted_when_ended() -> Iterator[None]:
    """Has a request to end the program interrupt the block as Ctrl-C does: SIGTERM, and Ctrl-Break on Windows."""
    number = signal.SIGBREAK if sys.platform == "win32" else signal.SIGTERM
    before = signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(number, before)
