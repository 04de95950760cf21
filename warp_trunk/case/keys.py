"""Keys and values of TOML: what is wrong with one is said in one line that names file, rule and value."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from warp_trunk.errors import InputError


def refuse_unknown(path: Path, table: Iterable[str], known: list[str], prefix: str) -> None:
    """InputError at a key that is not known, with the nearest one that is."""
    for key in table:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
            hint = f"did you mean '{prefix}{near[0]}'? " if near else ""
            raise InputError(
                f"{path}: unknown key '{prefix}{key}'; {hint}the keys are "
                + ", ".join(prefix + name for name in known)
            )


def numbers(path: Path, table: dict[str, Any], known: list[str], prefix: str) -> dict[str, float]:
    """The table, of which every value must be a number."""
    refuse_unknown(path, table, known, prefix)
    for key, value in table.items():
        if not is_number(value):
            raise InputError(f"{path}: '{prefix}{key}' must be a number, not {shown(value)}; correct it")
    return {key: float(value) for key, value in table.items()}


def is_number(value: object) -> bool:
    """Whether a value of TOML is a number that float holds; true and false are none."""
    return isinstance(value, float) or (
        isinstance(value, int) and not isinstance(value, bool) and abs(value) < 1e300
    )


def shown(value: object) -> str:
    """A value as a message shows it."""
    return f"{str(value)[:40]!r} ({type(value).__name__})" if isinstance(value, str) else f"{value}"[:60]


def quoted(text: str) -> str:
    """A TOML basic string: JSON's escapes are TOML's, but for DEL."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
