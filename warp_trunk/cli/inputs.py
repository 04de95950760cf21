"""Folders of bones and planes to cut at, as several commands take them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import read_surface, surface_files
from warp_trunk.preparation.scanning import CutPlane


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


def cut_planes(texts: Sequence[str], above: float | None, below: float | None) -> list[CutPlane]:
    """The planes of --cut, --cut-above and --cut-below.

    Raises:
        InputError: a text that is no point and normal.
    """
    planes = [_plane(text) for text in texts]
    if above is not None:
        planes.append(CutPlane((0.0, 0.0, above), (0.0, 0.0, 1.0)))
    if below is not None:
        planes.append(CutPlane((0.0, 0.0, below), (0.0, 0.0, -1.0)))
    return planes


def _plane(text: str) -> CutPlane:
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (6, 7):
        raise InputError(
            f"--cut: must be x,y,z,nx,ny,nz or x,y,z,nx,ny,nz,radius, not '{text}'; "
            "give a point, a normal and how far the cut reaches"
        )
    x, y, z, nx, ny, nz, *radius = numbers
    return CutPlane((x, y, z), (nx, ny, nz), radius[0] if radius else math.inf)
