"""Opening what others wrote: a regular file, of a size that fits, and for a case only in its folder."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from unicodedata import category

import numpy as np

from warp_trunk.errors import InputError, MissingFileError
from warp_trunk.system import limited_memory

MOST_SURFACE = 2_000_000_000
"""No surface or mesh is larger than this [bytes]."""
MOST_TEXT = 100_000_000
"""No table of landmarks or numbers is larger than this [bytes]."""

_PACKED = {b"\x1f\x8b": "gzip", b"BZh": "bzip2", b"\xfd7zXZ": "xz", b"PK\x03\x04": "zip"}
"""How files begin that are packed."""
_WINDOWS_NAN = re.compile(r"[-+]?(?:nan\(\w*\)|1\.#\w+)", re.IGNORECASE)
"""As Windows writes what is no number: -nan(ind), 1.#QNAN, -1.#IND, 1.#INF."""


class FormatError(ValueError):
    """The fault that a reader finds in a file, in words for whoever gave the file."""


def check_file(path: Path, expected: str, most: int = MOST_TEXT) -> int:
    """The size of a file [bytes].

    Raises:
        InputError: it is missing, is no regular file (a pipe or a device would never end), is larger than
            `most`, or cannot be opened; `expected` says what should be there.
    """
    try:
        if not path.is_file():
            if not path.exists():
                raise MissingFileError(f"{path}: there is no such file; {expected}")
            raise InputError(f"{path}: is no regular file; {expected}")
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
    """The content of a file.

    Raises:
        InputError: as `check_file`, or it is packed.
    """
    check_file(path, expected, most)
    content = path.read_bytes()
    if packer := next((name for start, name in _PACKED.items() if content.startswith(start)), None):
        raise InputError(f"{path}: is packed by {packer}; unpack it first, {expected}")
    return content


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
        raise MissingFileError(f"{path}: there is no folder {path.absolute().parent}; make it first")
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
    """The fault of a file in a few words. Those of a library name its code, not the file: they are left out."""
    if isinstance(error, FormatError):
        return " ".join(str(error).split())[:200]
    if isinstance(error, MemoryError):
        return "it needs more memory than a file of its size should"
    place = getattr(error, "position", None)  # of XML
    return "it is damaged, or of another format than its name says" + (f", at line {place[0]}" if place else "")


def parsed_number(text: str) -> float:
    """A number as files write it, also with a decimal comma, and NaN also as Windows writes it; float() would take
    1_000 for a thousand.

    Raises:
        FormatError: the text is none.
    """
    try:
        if "_" not in text:
            return float(text.replace(",", ".", 1))
    except ValueError:
        if _WINDOWS_NAN.fullmatch(text):
            return float("nan")
    raise FormatError(f"a number was expected, not {text[:40]!r}")


def numbers(words: Sequence[bytes | str]) -> np.ndarray:
    """Many numbers as `parsed_number`, float64."""
    try:
        if not any(b"_" in word if isinstance(word, bytes) else "_" in word for word in words):
            return np.array(words, dtype=np.float64)
    except ValueError:
        pass
    return np.array([parsed_number(word.decode("latin-1") if isinstance(word, bytes) else word) for word in words])


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
