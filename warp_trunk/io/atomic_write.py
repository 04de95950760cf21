"""Files that appear whole or not at all, also where the program is killed, the disk is full or power fails."""

from __future__ import annotations

import csv
import errno
import io
import os
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec


def partial(path: Path) -> Path:
    """The name of a file while it is being written; it keeps its ending, so that viewers open it anyway."""
    return path.with_name(f"{path.stem}.partial{path.suffix}")


def complete(path: Path) -> None:
    """Moves a file written under its partial name to its own.

    It lies on the disk before, so that its own name never stands for less, even after a power cut.
    """
    with partial(path).open("r+b") as file:  # Windows flushes only what can be written to
        os.fsync(file.fileno())
    replace(partial(path), path)


def replace(source: Path, target: Path) -> None:
    """Moves a file to the place of another. Windows refuses that while a program has the other open.

    Raises:
        PermissionError: a program still has it open after a second; scanners of files let go sooner.
    """
    for pause in (0.05, 0.2, 0.75, None):
        try:
            os.replace(source, target)
            return
        except PermissionError as error:
            if getattr(error, "winerror", None) is None:
                raise
            if pause is None:
                cure = f"{error.strerror}; close the program that has it open"
                raise PermissionError(error.errno, cure, str(target)) from error
        time.sleep(pause)


@contextmanager
def named(path: Path) -> Iterator[None]:
    """Names a path in the OSError of a block that has none, as where a disk is full."""
    try:
        yield
    except OSError as error:
        if error.filename:
            raise
        # NumPy's tofile gives no number: it has written less than it was given, as the disk is full
        number = error.errno or errno.ENOSPC
        raise OSError(number, os.strerror(number), str(path)) from error


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """The partial name, to write to in the block; at its end the file is complete, or removed if it failed."""
    try:
        with named(path):
            yield partial(path)
            complete(path)
    except BaseException:
        partial(path).unlink(missing_ok=True)
        raise


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a text in UTF-8, or bytes, as a file that is complete or not there."""
    with atomic_write(path) as unfinished:
        unfinished.write_bytes(content.encode() if isinstance(content, str) else content)


def json_text(record: object, enc_hook: Callable[[Any], Any] | None = None) -> bytes:
    """The text of a JSON file; `enc_hook` as in msgspec."""
    return msgspec.json.format(msgspec.json.encode(record, enc_hook=enc_hook), indent=2) + b"\n"


def csv_text(rows: Iterable[Iterable[object]]) -> str:
    """The text of a CSV file; numbers keep every digit."""
    file = io.StringIO()
    csv.writer(file, lineterminator="\n").writerows(rows)
    return file.getvalue()
