"""From a surface to a file, in the format of the file's ending."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.checking import checked
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface, check_surface

from ..atomic_write import named
from ..file_access import check_place
from .space import with_space

WRITTEN = (".ply", ".stl", ".obj", ".off", ".glb")
"""Endings of the files that are written."""


@checked
def write_surface(path: str | Path, surface: Surface, space: str | None = "LPS") -> None:
    """Write a surface in the format of the name's ending, vertices in their order; the write is atomic.

    The header says SPACE=LPS, as 3D Slicer writes and reads it, or another `space`, or nothing where it is None.
    PLY keeps float64, so that positions come back to the last bit; trimesh writes the other formats.

    >>> wt.write_surface(folder / "skin.stl", case.skin)
    >>> len(wt.read_surface(folder / "skin.stl").faces) == len(case.skin.faces)
    True

    Raises InputError for an ending that is not in `WRITTEN`, and OSError when the file cannot be written.
    """
    path = Path(path)
    if space not in (None, "LPS", "RAS"):
        raise InputError(f"write_surface: 'space' must be LPS or RAS, not {space!r}; give one of them")
    check_written(path)
    check_surface(surface, f"{path}: 'surface'")
    unfinished = path.with_name(f".{path.name}.partial")  # hidden, so that it is never read as a bone
    content = _ply_bytes(surface, space) if path.suffix.lower() == ".ply" else _exported(path, surface, space)
    try:
        with named(path):
            unfinished.write_bytes(content)
            unfinished.replace(path)
    except OSError:
        unfinished.unlink(missing_ok=True)
        raise


def check_written(path: Path) -> None:
    """InputError where a name's ending is none that is written, or it cannot be written there."""
    if path.suffix.lower() not in WRITTEN:
        cure = f"end the name in one of {', '.join(WRITTEN)}"
        raise InputError(f"{path}: a surface cannot be written as '{path.suffix}'; {cure}")
    check_place(path)


def _exported(path: Path, surface: Surface, space: str | None) -> bytes:
    import trimesh  # heavy

    mesh = trimesh.Trimesh(surface.vertices, surface.faces, vertex_colors=surface.colours, process=False)
    ending = path.suffix.lower()
    content: Any = mesh.export(file_type=ending[1:])
    content = content.encode() if isinstance(content, str) else content
    return content if space is None else with_space(ending, content, space)


def _ply_bytes(surface: Surface, space: str | None) -> bytes:
    """Binary PLY with float64 positions; trimesh 5.2 rounds them to float32, 6e-5 mm at 1 m, and meshio 5.3 writes
    the time of day into the header, so that no two files are the same."""
    comment = "" if space is None else f"comment SPACE={space}\n"
    kind, colour = np.dtype([("place", "<f8", 3)]), ""
    if surface.colours is not None:
        kind = np.dtype([*kind.descr, ("colour", "u1", 3)])
        colour = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    vertices = np.empty(len(surface.vertices), kind)
    vertices["place"] = surface.vertices
    if surface.colours is not None:
        vertices["colour"] = surface.colours
    header = (
        f"ply\nformat binary_little_endian 1.0\n{comment}element vertex {len(vertices)}\nproperty double x\n"
        f"property double y\nproperty double z\n{colour}element face {len(surface.faces)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    triangles = np.empty(len(surface.faces), dtype=[("count", "<u1"), ("corners", "<i4", 3)])
    triangles["count"] = 3
    triangles["corners"] = surface.faces
    return header.encode() + vertices.tobytes() + triangles.tobytes()
