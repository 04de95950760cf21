"""A folder of bones, as commands take it."""

from __future__ import annotations

from pathlib import Path

from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import read_surface, surface_files


def read_bones(folder: Path) -> dict[str, Surface]:
    """Surfaces by the names of their files, sorted.

    Raises:
        InputError: no such folder, no surface in it, or one that cannot be read.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder; --bones is a folder of bone surfaces")
    files = surface_files(folder)
    if not files:
        raise InputError(f"{folder}: there is no surface in it; give each bone as <name>.ply")
    return {name: read_surface(path) for name, path in files.items()}
