"""From a file to a surface, by the file's ending."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.checking import checked
from warp_trunk.errors import InputError
from warp_trunk.geometry.colours import as_colours, mean_colours
from warp_trunk.geometry.surface import Surface, check_surface

from ..file_access import MOST_SURFACE, FormatError, check_file, parsing, read_bytes
from .by_trimesh import read_glb, read_off, read_stl
from .ply import read_ply
from .polygons import read_obj
from .space import stated_space
from .vtk import read_vtk, read_vtp

_READERS: dict[str, Callable[..., tuple[Any, ...]]] = {
    ".ply": read_ply,
    ".stl": read_stl,
    ".obj": read_obj,
    ".off": read_off,
    ".glb": read_glb,
    ".vtp": read_vtp,
    ".vtk": read_vtk,
}
_LARGEST_BODY = 3.0
"""A surface of larger extent is not in metres; one of smaller extent is not in mm."""
ENDINGS = frozenset(_READERS)
"""Endings of the files that are read."""


def cure_of(ending: str, kinds: str) -> str:
    """The cure for a file of another ending than the `kinds` that are read."""
    if ending in (".usdz", ".usd", ".usda", ".usdc"):
        return "export it as PLY, OBJ or GLB in the app that scanned, or open it in Blender and export it there"
    return (
        f"unpack it first, or use {kinds}" if ending in (".gz", ".zip", ".xz", ".bz2", ".zst") else f"use {kinds}"
    )


def surface_files(folder: Path, stem: str | None = None) -> dict[str, Path]:
    """The surface files of a folder by name without ending, sorted; only those called `stem` where given.

    Hidden files, folders and pipes are passed over.

    Raises:
        InputError: two files of one name.
    """
    files: dict[str, Path] = {}
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        ours = path.is_file() and path.suffix.lower() in ENDINGS and not path.name.startswith(".")
        if not ours or (stem is not None and path.stem != stem):
            continue
        if path.stem in files:
            raise InputError(
                f"{path}: there is {files[path.stem].name} beside it; give '{path.stem}' in one file "
                "and remove the other"
            )
        files[path.stem] = path
    return files


@checked
def read_surface(path: str | Path) -> Surface:
    """Read a surface from a .ply, .stl, .obj, .off, .glb, .vtp or .vtk file; the numbers are taken as mm.

    They are taken as LPS; a file whose header says SPACE=RAS, as those of 3D Slicer may, is converted. A GLB that
    reaches over less than 3 is in metres, as glTF has it, and is converted to mm.

    The order of the vertices stays as it is in the file; those in no triangle are left out. Only where the file
    repeats the corners of every triangle (STL) or vertices along the seams of a texture, which opens the surface
    there, identical points become one vertex, in the order they first appear. The nodes of a GLB move its meshes.

    Colours of the vertices of a PLY, an OBJ (`v x y z r g b`) and a GLB are read, and textures of an OBJ and a GLB
    become colours of the vertices. The materials and pictures that an OBJ names are opened only where they lie in
    its own folder; no other file is.

    >>> wt.write_surface(folder / "skin.ply", case.skin)
    >>> bool(np.array_equal(wt.read_surface(folder / "skin.ply").vertices, case.skin.vertices))
    True

    Raises InputError when the file is missing, too large or cannot be read, has no triangles, or has a vertex
    that is not finite or out of reach.
    """
    return in_lps(*read_stated(Path(path)))


def in_lps(surface: Surface, space: str | None) -> Surface:
    """A surface of a file that states its axes, in LPS."""
    return surface.moved(surface.vertices * (-1.0, -1.0, 1.0)) if space == "RAS" else surface


def read_stated(path: Path, size: float = 1.0) -> tuple[Surface, str | None]:
    """A surface in a unit of so many mm, and the axes that the file states; InputError as `read_surface`.

    Args:
        path: of the file.
        size: mm in the unit of files that state none; a GLB in metres is converted to it.
    """
    kinds = ", ".join(sorted(ENDINGS))
    ending, expected = path.suffix.lower(), f"a surface file ({kinds}) was expected"
    if ending not in ENDINGS:
        check_file(path, expected, MOST_SURFACE)
        raise InputError(
            f"{path}: cannot be read as a surface ('{ending}' is not known); {cure_of(ending, kinds)}"
        )
    content = read_bytes(path, expected, MOST_SURFACE)
    with parsing(path, "a surface", len(content)):
        surface = parse_surface(ending, content, path)
        space = stated_space(ending, content)
    surface = surface.moved(in_unit(ending, surface.vertices, size))
    check_surface(surface, str(path))
    return surface, space


def in_unit(ending: str, vertices: np.ndarray, size: float) -> np.ndarray:
    """The vertices of a file in a unit of so many mm: those of a GLB are in metres, as glTF has it, where they
    reach over less than a body does in mm."""
    metres = ending == ".glb" and np.ptp(vertices, axis=0).max(initial=0.0) < _LARGEST_BODY
    return 1000.0 / size * vertices if metres else vertices


def parse_surface(ending: str, content: bytes, path: Path | None = None) -> Surface:
    """The surface of a file in the order of the file; polygons become fans.

    Identical points become one vertex, in the order they first appear, where the file repeats the corners of
    every triangle, in a GLB, which repeats them wherever a texture or a normal changes, and where this closes
    edges that are open.

    Args:
        ending: one of `ENDINGS`.
        content: the whole file.
        path: of the file, where files beside it may be opened.

    Raises:
        Exception: of many kinds, where the content is not of that format.
    """
    beside = (path,) if ending == ".obj" else ()
    vertices, faces, *rest = _READERS[ending](content, *beside)
    numbers = rest[0] if rest else None
    vertices = np.array(vertices, dtype=np.float64).reshape(-1, 3)
    faces = np.asarray(faces).reshape(-1, 3)
    if faces.size and not (faces.min() >= 0 and faces.max() < len(vertices)):
        raise FormatError(
            f"triangles name vertices {faces.min()} to {faces.max()}, there are 0 to {len(vertices) - 1}"
        )
    faces = faces.astype(np.int32)
    used = np.unique(faces)
    if len(used) < len(vertices):  # what no triangle has decides nothing
        vertices, faces = vertices[used], np.searchsorted(used, faces).astype(np.int32)
        numbers = None if numbers is None else np.asarray(numbers)[used]
    if len(faces) and (ending == ".glb" or len(np.unique(faces)) == faces.size):
        return _merged(vertices, faces, numbers)
    from warp_trunk.geometry.surface_checks import boundary_edges  # brings Warp

    open_edges = boundary_edges(faces)
    rim = np.unique(open_edges)
    if len(np.unique(vertices[rim], axis=0)) < len(rim):
        welded = _merged(vertices, faces, numbers)
        if len(boundary_edges(welded.faces)) < len(open_edges):
            return welded
    return _surface(vertices, faces, numbers)


def _surface(vertices: np.ndarray, faces: np.ndarray, numbers: np.ndarray | None) -> Surface:
    return Surface(vertices, faces, None if numbers is None else as_colours(numbers, vertices))


def _merged(vertices: np.ndarray, faces: np.ndarray, numbers: np.ndarray | None) -> Surface:
    _, first, inverse = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    in_file_order = np.argsort(first)
    number = np.argsort(in_file_order).astype(np.int32)[inverse.reshape(-1)]
    if numbers is not None:
        numbers = mean_colours(np.asarray(numbers, dtype=np.float64)[:, :3], number, len(first))
    return _surface(vertices[first[in_file_order]], number[faces], numbers)
