"""A command line to go on with, as a shell takes it."""

from __future__ import annotations

import shlex
from pathlib import Path


def next_command(*words: str | Path) -> str:
    """The words of a command after `warp-trunk`, quoted where a path has spaces or signs that a shell reads."""
    return shlex.join(["warp-trunk", *map(str, words)])
