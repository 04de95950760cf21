"""A triangulated surface, and reading and writing one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.io.file_access import FARTHEST, MOST_SURFACE, check_place, limited_memory, read_bytes, reason
from warp_trunk.io.surface_files import ENDINGS, parse

WRITTEN = (".ply", ".stl", ".obj", ".off", ".glb")
"""Endings of the files that are written."""


@dataclass(frozen=True)
class Surface:
    """Triangles in patient axes (LPS: +x left, +y back, +z up)."""

    vertices: np.ndarray
    """Positions [mm], shape (vertices, 3), float64."""
    faces: np.ndarray
    """Vertex indices, counterclockwise seen from outside, shape (faces, 3), int32."""


def read_surface(path: str | Path) -> Surface:
    """Read a surface from a .ply, .stl, .obj, .off, .glb, .vtp or .vtk file; the numbers are taken as mm.

    The order and the count of the vertices stay as they are in the file. Only where the file repeats the
    corners of every triangle (STL, and GLB at the seams of a texture) are identical points made one vertex, in
    the order they first appear. The nodes of a GLB move its meshes. No other file is opened, whatever it names.

    Raises InputError when the file is missing, too large or cannot be read, has no triangles, or has a vertex
    that is not finite or out of reach.
    """
    path = Path(path)
    kinds = ", ".join(sorted(ENDINGS))
    content = read_bytes(path, f"a surface file ({kinds}) was expected", MOST_SURFACE)
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise InputError(f"{path}: cannot be read as a surface ('{ending}' is not known); use {kinds}")
    try:
        with limited_memory(len(content)):
            vertices, faces = parse(ending, content)
    except Exception as error:  # each format fails with errors of its own
        raise InputError(f"{path}: cannot be read as a surface ({reason(error)}); write it again") from error
    surface = Surface(vertices, faces)
    check_surface(surface, str(path))
    return surface


def write_surface(path: str | Path, surface: Surface) -> None:
    """Write a surface in the format of the name's ending, vertices in their order; whole or not at all.

    PLY keeps float64, so that positions come back to the last bit; trimesh writes the other formats.

    Raises InputError for an ending that is not in `WRITTEN`, and OSError when the file cannot be written.
    """
    path = Path(path)
    check_written(path)
    unfinished = path.with_name(f".{path.name}.partial")  # hidden, so that it is never read as a bone
    content = _ply_bytes(surface) if path.suffix.lower() == ".ply" else _exported(path, surface)
    try:
        unfinished.write_bytes(content)
        unfinished.replace(path)
    except OSError:
        unfinished.unlink(missing_ok=True)
        raise


def check_written(path: Path) -> None:
    """InputError where a name's ending is none that is written, or it cannot be written there."""
    if path.suffix.lower() not in WRITTEN:
        known = ", ".join(WRITTEN)
        raise InputError(f"{path}: a surface cannot be written as '{path.suffix}'; end the name in one of {known}")
    check_place(path)


def _exported(path: Path, surface: Surface) -> bytes:
    import trimesh  # heavy

    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    content: Any = mesh.export(file_type=path.suffix.lower()[1:])
    return content.encode() if isinstance(content, str) else content


def check_surface(surface: Surface, name: str) -> None:
    """Check that a surface has triangles, finite vertices, and faces that name vertices it has.

    Raises InputError whose text starts with `name`.
    """
    vertices, faces = surface.vertices, surface.faces
    if len(vertices) == 0 or len(faces) == 0:
        raise InputError(
            f"{name}: the surface is empty ({len(vertices)} vertices, {len(faces)} triangles); "
            "give a closed surface"
        )
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if bad.size:
        raise InputError(
            f"{name}: {bad.size} vertices are not finite, the first is number {bad[0]}, "
            f"{vertices[bad[0]].tolist()}; repair the surface"
        )
    far = float(np.abs(vertices).max())
    if far > FARTHEST:
        raise InputError(
            f"{name}: a vertex is at {far:.3g}, coordinates may be {FARTHEST:g} at most; repair the surface"
        )
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(
            f"{name}: triangles name vertices {faces.min()} to {faces.max()}, the surface has 0 to "
            f"{len(vertices) - 1}; repair the surface"
        )


def _ply_bytes(surface: Surface) -> bytes:
    """Binary PLY with float64 positions; trimesh would round them to float32, 6e-5 mm at 1 m."""
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(surface.vertices)}\n"
        "property double x\nproperty double y\nproperty double z\n"
        f"element face {len(surface.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    triangles = np.empty(len(surface.faces), dtype=[("count", "<u1"), ("corners", "<i4", 3)])
    triangles["count"] = 3
    triangles["corners"] = surface.faces
    return header.encode() + surface.vertices.astype("<f8").tobytes() + triangles.tobytes()
