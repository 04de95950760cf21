"""A further command line to paste into a shell."""

from __future__ import annotations

import os
import shlex
from pathlib import Path


def next_command(*words: str | Path) -> str:
    """A command line of `warp-trunk`, quoted for a shell; it starts with `uv run` where this process does."""
    start = ["uv", "run", "warp-trunk"] if "UV_RUN_RECURSION_DEPTH" in os.environ else ["warp-trunk"]
    return shlex.join([*start, *map(str, words)])
