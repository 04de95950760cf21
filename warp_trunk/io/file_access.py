"""Opening what others wrote: a regular file, of a size that fits, and for a case only in its folder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unicodedata import category

from warp_trunk.errors import InputError
from warp_trunk.system import limited_memory

MOST_SURFACE = 2_000_000_000
"""No surface or mesh is larger than this [bytes]."""
MOST_TEXT = 100_000_000
"""No table of landmarks or numbers is larger than this [bytes]."""


def check_file(path: Path, expected: str, most: int = MOST_TEXT) -> int:
    """The size of a file [bytes].

    Raises:
        InputError: it is missing, is no regular file (a pipe or a device would never end), is larger than
            `most`, or cannot be opened; `expected` says what should be there.
    """
    try:
        if not path.is_file():
            what = "is no regular file" if path.exists() else "there is no such file"
            raise InputError(f"{path}: {what}; {expected}")
        with path.open("rb"):
            size = path.stat().st_size
    except (OSError, ValueError) as error:  # ValueError: a name with a null character
        if isinstance(error, InputError):
            raise
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{path}: cannot be opened ({reason}); {expected}") from error
    if size > most:
        raise InputError(f"{path}: has {size / 1e6:.0f} MB, {most / 1e6:.0f} MB is the most; {expected}")
    return size


def read_bytes(path: Path, expected: str, most: int = MOST_TEXT) -> bytes:
    """The content of a file; InputError as `check_file`."""
    check_file(path, expected, most)
    return path.read_bytes()


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


def check_place(path: Path) -> None:
    """Check, before there is anything to write, that a file can stand at a path.

    Raises:
        InputError: its folder is missing, or it is a folder itself.
    """
    if not path.absolute().parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.absolute().parent}; make it first")
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give the name of a file")


def check_within(folder: Path, path: Path) -> None:
    """Check that a file of a folder lies in it, also where links lead; the folder itself may be a link.

    Raises:
        InputError: the file lies elsewhere.
    """
    try:
        inside = path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):  # a name that cannot be one, or links in a circle
        inside = False
    if not inside:
        raise InputError(f"{path}: lies outside the case folder {folder}, and nothing else is read; copy it there")


def reason(error: BaseException) -> str:
    """The error of a library in a few words; that of a ValueError says enough without its name."""
    name = "" if type(error) is ValueError else f"{type(error).__name__}: "
    return " ".join(f"{name}{error}".split())[:200]


def number(text: str) -> float:
    """A number as files write it; float() would also take 1_000 for a thousand.

    Raises:
        ValueError: the text is none.
    """
    if "_" in text:
        raise ValueError(f"could not convert string to float: {text!r}")
    return float(text)


def is_plain(name: str) -> bool:
    """Whether a name has no line breaks, control characters or halves of characters, so that files can hold it."""
    return not any(category(letter) in ("Cc", "Cs", "Zl", "Zp") for letter in name)


@contextmanager
def parsing(path: Path, what: str, size: int) -> Iterator[None]:
    """Limits the memory of a block that parses a file of `size` bytes, and names the file where it fails.

    Raises:
        InputError: the block failed; each format, and each library, fails with errors of its own.
    """
    try:
        with limited_memory(size):
            yield
    except InputError:
        raise
    except (Exception, SystemExit) as error:  # meshio ends the program on some
        raise InputError(f"{path}: cannot be read as {what} ({reason(error)}); write it again") from error
