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
    handle = _take(folder)
    try:
        os.truncate(handle, 0)
        os.write(handle, f"{os.getpid()}\n".encode())
        yield
    finally:
        (folder / LOCK).unlink(missing_ok=True)
        os.close(handle)


def _take(folder: Path) -> int:
    import fcntl  # not on Windows

    while True:
        handle = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _is_there(handle, folder / LOCK):
                return handle
        except BlockingIOError:
            owner = os.read(handle, 20).decode(errors="replace").strip() or "unknown"
            os.close(handle)
            raise InputError(
                f"{folder}: process {owner} writes its result here; wait for its end or give another --out"
            ) from None
        os.close(handle)  # the process before has just removed the file: another may have made a new one


def _is_there(handle: int, path: Path) -> bool:
    """Whether the open file is the one that lies there now."""
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False
