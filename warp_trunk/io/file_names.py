"""Names of files that every system takes, as cases and results travel between them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from warp_trunk.errors import InputError

_RESERVED = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|(com|lpt)[0-9¹²³])(\..*)?", re.IGNORECASE)
"""Devices of Windows, with any ending."""
_REFUSED = re.compile(r'[<>:"/\\|?*\x00-\x1f]')
"""Characters that Windows or another system refuses in names."""
_LONGEST = 200
"""Bytes of a name in UTF-8; 255 are possible, and endings are added."""


def check_file_names(names: Iterable[str], what: str) -> None:
    """Check that names can be those of files in one folder, on Linux, macOS and Windows.

    Args:
        names: without their endings.
        what: what they name, with which a message begins.

    Raises:
        InputError: one cannot, or two differ only in capital letters.
    """
    before: dict[str, str] = {}
    for name in names:
        if fault := _fault(name):
            raise InputError(f"{what}: '{name}' {fault}, and must be a valid file name on every system; rename it")
        other = before.setdefault(name.casefold(), name)
        if other != name:
            raise InputError(
                f"{what}: '{name}' and '{other}' differ only in capital letters, which are the same file on "
                "Windows and macOS; rename one"
            )


def _fault(name: str) -> str:
    """The reason why a name cannot be that of a file; empty where it can."""
    if refused := _REFUSED.search(name):
        return f"has the character {refused[0]!r}"
    if _RESERVED.fullmatch(name):
        return "is a device of Windows"
    if not name or name.startswith(".") or name.endswith((".", " ")):
        return "is empty, or begins or ends with a dot or ends with a space"
    if len(name.encode(errors="replace")) > _LONGEST:
        return f"is longer than {_LONGEST} bytes"
    return ""


def name_of(path: Path) -> str:
    """The name of a file or folder as text that can be written: bytes that are not UTF-8 become U+FFFD."""
    return path.name.encode("utf-8", "surrogateescape").decode("utf-8", "replace")


def path_in(folder: Path, text: str) -> Path:
    """The file of a folder that a text file names, also with the backslashes of Windows."""
    return folder / text.replace("\\", "/")
