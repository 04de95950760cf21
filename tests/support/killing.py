"""A process that is lost while it simulates."""

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from warp_trunk.io.folders import LOCK

PATIENCE = 120.0
"""How long a process at work is waited for [s]."""


@contextmanager
def killed_at_work(out: Path) -> Iterator[list[int]]:
    """Meanwhile the first process that writes a result into a folder of `out` is killed with signal 9.

    The list holds its id once it is; this process is spared.
    """
    killed: list[int] = []
    over = threading.Event()

    def kill() -> None:
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until and not over.wait(0.02):
            for lock in out.glob(f"*/{LOCK}"):
                text = lock.read_text().strip() if lock.exists() else ""
                if text and int(text) != os.getpid():
                    os.kill(int(text), signal.SIGKILL)
                    killed.append(int(text))
                    return

    watcher = threading.Thread(target=kill)
    watcher.start()
    try:
        yield killed
    finally:
        over.set()
        watcher.join()
