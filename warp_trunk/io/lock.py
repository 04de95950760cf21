"""One process at a time writes into a result folder."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from warp_trunk.errors import InputError

LOCK = ".lock"
"""The file that the process writing into a folder holds, with its number."""


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keeps other processes out of a folder while the block runs; the lock ends with the process, however it ends.

    Raises:
        InputError: another process holds it, by this or another name of the folder.
    """
    from filelock import FileLock, Timeout

    path = folder / LOCK
    lock = FileLock(path, timeout=0.2, poll_interval=0.05)  # again where the process before has just removed it
    try:
        lock.acquire()
    except Timeout:
        owner = path.read_text(errors="replace").strip() if path.is_file() else "unknown"
        raise InputError(
            f"{folder}: process {owner} writes its result here; wait for its end or give another --out"
        ) from None
    try:
        path.write_text(f"{os.getpid()}\n")
        yield
    finally:
        path.unlink(missing_ok=True)
        lock.release()
