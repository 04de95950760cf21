"""Meshes of other programs, read so that a damaged file neither ends the program nor fills the memory."""

from __future__ import annotations

import re
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import FARTHEST

from .file_access import MOST_SURFACE, FormatError, parsing, read_bytes
from .surface_files.space import stated_space
from .surface_files.vtk import read_vtk_grid, read_vtu

ENDINGS = (".vtu", ".vtk", ".xdmf", ".msh", ".inp")
"""Endings of the files that are read."""
_ELSEWHERE = {
    ".inp": (rb"(?im)^\s*\*\s*include\b", "*INCLUDE"),
    ".xdmf": (rb"""(?i)\bformat\s*=\s*["']\s*(hdf|binary|tiff)""", "data in other files"),
}
"""Entries that would make meshio open another file."""


def read_mesh(path: Path) -> Any:
    """A meshio.Mesh; no other file is opened, whatever the file names.

    Raises:
        InputError: it is missing, of another format, too large, damaged, or keeps data in other files.
    """
    import meshio  # heavy

    # meshio.read would end the program on a file that is damaged
    readers: dict[str, Callable[[str], Any]] = {
        ".vtu": lambda name: read_vtu(Path(name).read_bytes()),
        ".vtk": lambda name: read_vtk_grid(Path(name).read_bytes()),
        ".xdmf": meshio.xdmf.read,
        ".msh": meshio.gmsh.read,
        ".inp": _read_abaqus,
    }
    ending = path.suffix.lower()
    if path.is_file() and ending not in readers:
        raise InputError(f"{path}: '{path.suffix}' is not read as a mesh; use {', '.join(ENDINGS)}")
    content = read_bytes(path, f"a mesh of tetrahedra ({', '.join(ENDINGS)}) was expected", MOST_SURFACE)
    pattern, what = _ELSEWHERE.get(ending, (rb"(?!)", ""))
    if re.search(pattern, content):
        raise InputError(f"{path}: has {what}, and other files are not opened; write the mesh into one file")
    if ending in (".vtu", ".xdmf") and (b"<!DOCTYPE" in content or b"<!ENTITY" in content):
        raise InputError(f"{path}: defines entities, which no mesh needs; write it again")
    with parsing(path, "a mesh", len(content)):
        mesh = readers[ending](str(path))
        space = stated_space(ending, content)
    points = np.asarray(mesh.points)
    if points.ndim != 2 or points.shape[1] != 3 or not (np.abs(points) <= FARTHEST).all():  # nor is NaN
        raise InputError(
            f"{path}: nodes must have three finite coordinates within {FARTHEST:g} (there are {points.shape}); "
            "write it again"
        )
    if space == "RAS":
        mesh.points = points * (-1.0, -1.0, 1.0)
    return mesh


def _read_abaqus(path: str) -> Any:
    """A file of Abaqus, whose linear tetrahedra have a letter more for what they solve for, as C3D4H; meshio 5.3
    knows C3D4 alone."""
    import meshio  # heavy

    tables: Any = meshio.abaqus
    text = Path(path).read_text("utf-8", "replace")
    linear = re.sub(r"(?im)^(\s*\*\s*element\b.*\btype\s*=\s*C3D4)[A-Z]+", r"\1", text)
    kinds = re.findall(r"(?im)^\s*\*\s*element\b.*?\btype\s*=\s*(\w+)", linear)
    if unread := [kind for kind in kinds if kind.upper() not in tables._abaqus.abaqus_to_meshio_type]:
        raise FormatError(f"its elements {unread[0]} are not read; write tetrahedra C3D4")
    return meshio.abaqus.read(StringIO(linear))
