"""Output of commands, and their exit statuses."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

OK, NOT_CONVERGED, BAD_INPUT, INCOMPLETE, INTERRUPTED = 0, 1, 2, 3, 130
"""Exit statuses; INCOMPLETE where a command did what it could and named what it could not."""
NOT_READY = NOT_CONVERGED
"""Exit status of `doctor` if something essential is missing."""


def next_command(*words: str | Path) -> str:
    """A command line of `warp-trunk`, quoted for a shell; it starts with `uv run` where this process does."""
    start = ["uv", "run", "warp-trunk"] if "UV_RUN_RECURSION_DEPTH" in os.environ else ["warp-trunk"]
    return shlex.join([*start, *map(str, words)])


def mean_and_largest(errors: np.ndarray, names: Sequence[str] = (), unit: str = "mm") -> str:
    """Mean and largest of errors, shape (n,), and the name of the largest; NaN are passed over."""
    import numpy as np  # --help does without it

    worst = f" ({names[int(np.nanargmax(errors))]})" if names else ""
    return f"mean {np.nanmean(errors):.2f}, largest {np.nanmax(errors):.2f} {unit}{worst}"
