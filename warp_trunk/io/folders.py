"""Folders to write to: writable before any long work, locked for one process, removed where they stay empty."""

from __future__ import annotations

import errno
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from warp_trunk.errors import InputError

LOCK = ".lock"
"""The file that the process writing into a folder holds, with its number."""

WITHOUT_LOCKS = errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP
"""Errors of file systems that have no locks, such as some that are mounted over a network."""
UNLOCKED = "this file system has no locks; let no other process write there until this one ends"


def make_writable(folder: Path, what: str) -> None:
    """Makes a folder and sees that files can be written to it.

    Args:
        folder: the folder.
        what: what is to be written, as the subject of a sentence: 'a result'.

    Raises:
        InputError: it cannot be made or written to.
    """
    probe = folder / ".writable"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"x")
        probe.unlink(missing_ok=True)  # another process may be at the same place
    except OSError as error:
        raise InputError(
            f"{folder}: {what} cannot be written here ({error.strerror}); give --out a folder of your own"
        ) from error


@contextmanager
def removed_if_empty(folder: Path) -> Iterator[None]:
    """Removes a folder, and those above it, where they were not there before the block and are empty after it."""
    new = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        yield
    finally:
        with suppress(OSError):  # something is in it
            for path in new:
                path.rmdir()


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
        owner = "another process"
        with suppress(OSError):  # no other process can read it on Windows
            owner = f"process {path.read_text(encoding='utf-8', errors='replace').strip()}"
        raise InputError(
            f"{folder}: {owner} writes its result here; wait for its end or give another --out"
        ) from None
    except (OSError, NotImplementedError) as error:
        if isinstance(error, OSError) and error.errno not in WITHOUT_LOCKS:
            raise
        warnings.warn(f"{folder}: {UNLOCKED}", stacklevel=2)
    try:
        with suppress(OSError):
            path.write_bytes(b"%d\n" % os.getpid())
        yield
    finally:
        with suppress(OSError):
            path.unlink(missing_ok=True)
        lock.release()
        with suppress(OSError):  # Windows removes no open file
            path.unlink(missing_ok=True)


def seen_from_here(path: Path) -> Path:
    """A path as it is given from the working folder, if it lies in that; to be shown."""
    working_folder = Path.cwd()
    return path.relative_to(working_folder) if path.is_relative_to(working_folder) else path
