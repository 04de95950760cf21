"""Opening what others wrote: a regular file, of a size that fits, and for a case only in its folder."""

from __future__ import annotations

from pathlib import Path

from .errors import InputError

MOST_SURFACE = 2_000_000_000
"""No surface or mesh is larger than this [bytes]."""
MOST_TEXT = 100_000_000
"""No table of landmarks or numbers is larger than this [bytes]."""


def read_bytes(path: Path, expected: str, most: int = MOST_TEXT) -> bytes:
    """The content of a file.

    Raises:
        InputError: it is missing, is no regular file (a pipe or a device would never end), is larger than
            `most`, or cannot be opened; `expected` says what should be there.
    """
    try:
        if not path.is_file():
            what = "is no regular file" if path.exists() else "there is no such file"
            raise InputError(f"{path}: {what}; {expected}")
        size = path.stat().st_size
        if size > most:
            raise InputError(f"{path}: has {size / 1e6:.0f} MB, {most / 1e6:.0f} MB is the most; {expected}")
        return path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a name with a null character
        if isinstance(error, InputError):
            raise
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{path}: cannot be opened ({reason}); {expected}") from error


def read_text(path: Path, expected: str, most: int = MOST_TEXT) -> str:
    """The text of a file in UTF-8, with or without a byte order mark, its lines ended by a newline each.

    Raises:
        InputError: as `read_bytes`, or it is no UTF-8.
    """
    try:
        text = read_bytes(path, expected, most).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: is no text in UTF-8 ({error.reason} at byte {error.start}); {expected}"
        ) from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def check_within(folder: Path, path: Path) -> None:
    """Check that a file of a folder lies in it, also where links lead; the folder itself may be a link.

    Raises:
        InputError: the file lies elsewhere.
    """
    if not path.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{path}: lies outside the case folder {folder}, and nothing else is read; copy it there")
