"""Folders to write to: known to take files before any long work, and gone again where nothing was put in them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from warp_trunk.errors import InputError


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
