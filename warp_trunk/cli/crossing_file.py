"""The triangles that cross, as a file to look at."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from warp_trunk.errors import InputError
from warp_trunk.io.surface_files import write_surface
from warp_trunk.meshing import CrossingError

CROSSINGS = "crossings.ply"


@contextmanager
def crossings_written(folder: Path) -> Iterator[None]:
    """Writes the triangles of a CrossingError to `crossings.ply` in a folder, and says so in its text.

    Raises:
        InputError: in place of the CrossingError.
    """
    try:
        yield
    except CrossingError as error:
        path = folder / CROSSINGS
        try:
            folder.mkdir(parents=True, exist_ok=True)
            write_surface(path, error.triangles)
        except OSError:
            raise error from None
        raise InputError(f"{error}; look at the triangles that cross in {path}") from error
