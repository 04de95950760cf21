"""Shared by commands: exit statuses, lines to print, bones and planes to read."""

from __future__ import annotations

import math
import os
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from warp_trunk.errors import InputError, MissingFileError

if TYPE_CHECKING:
    import numpy as np

    from warp_trunk.geometry.cutting import CutPlane
    from warp_trunk.geometry.surface import Surface

OK, NOT_CONVERGED, BAD_INPUT, INCOMPLETE, FILE_ERROR, INTERRUPTED = 0, 1, 2, 3, 4, 130
EXIT_STATUSES = {
    OK: "The command did all it was asked.",
    NOT_CONVERGED: "A relaxation did not converge; what it reached is written.",
    BAD_INPUT: "The input is refused; nothing is written.",
    INCOMPLETE: "Something is missing, which the command names; everything else is written.",
    FILE_ERROR: "The system refuses to read or write a file, for example because the disk is full.",
    INTERRUPTED: "The command was interrupted with Ctrl-C.",
}
"""The meaning of each exit status."""


def next_command(*words: str | Path) -> str:
    """A command line of `warp-trunk`, quoted for a shell; it starts with `uv run` where this process does."""
    start = ["uv", "run", "warp-trunk"] if "UV_RUN_RECURSION_DEPTH" in os.environ else ["warp-trunk"]
    return shlex.join([*start, *map(str, words)])


def mean_and_largest(errors: np.ndarray, names: Sequence[str] = (), unit: str = "mm") -> str:
    """Mean and largest of errors, shape (n,), and the name of the largest; NaN are ignored."""
    import numpy as np  # --help does without it

    worst = f" ({names[int(np.nanargmax(errors))]})" if names else ""
    return f"mean {np.nanmean(errors):.2f}, largest {np.nanmax(errors):.2f} {unit}{worst}"


def read_bones(folder: Path, read: Callable[[Path], Surface] | None = None) -> dict[str, Surface]:
    """Surfaces by the names of their files, sorted; read by `read_surface` where nothing else is given.

    Raises:
        InputError: no such folder, no surface in it, a name that is nearly one of a bone, or one that cannot be
            read.
    """
    from warp_trunk.case.anatomy import check_bone_names
    from warp_trunk.io.surface_files import read_surface, surface_files

    files = surface_files(folder) if folder.is_dir() else {}
    if not files:
        raise MissingFileError(
            f"{folder}: there is no such folder with surfaces; give each bone as <name>.ply in it"
        )
    check_bone_names(files)
    return {name: (read or read_surface)(path) for name, path in files.items()}


def cut_planes(texts: Sequence[str], above: float | None, below: float | None) -> list[CutPlane]:
    """The planes of --cut, --cut-above and --cut-below; InputError for a text that is no point and normal."""
    from warp_trunk.geometry.cutting import CutPlane

    planes = []
    for text in texts:
        try:
            numbers = [float(word) for word in text.split(",")]
            x, y, z, nx, ny, nz, radius = numbers if len(numbers) == 7 else [*numbers, math.inf]
        except ValueError:  # too few or too many of them, too
            cure = "give a point, a normal and, if wanted, how far the cut reaches"
            raise InputError(f"--cut: must be x,y,z,nx,ny,nz or with a radius, not '{text}'; {cure}") from None
        planes.append(CutPlane((x, y, z), (nx, ny, nz), radius))
    ends = ((above, 1.0), (below, -1.0))
    return planes + [CutPlane((0.0, 0.0, z), (0.0, 0.0, up)) for z, up in ends if z is not None]
