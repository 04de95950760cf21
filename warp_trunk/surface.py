"""A triangulated surface, and reading and writing one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .errors import InputError


@dataclass(frozen=True)
class Surface:
    """Triangles in patient axes (LPS: +x left, +y back, +z up)."""

    vertices: np.ndarray
    """Positions [mm], shape (vertices, 3), float64."""
    faces: np.ndarray
    """Vertex indices, counterclockwise seen from outside, shape (faces, 3), int32."""


def read_surface(path: str | Path) -> Surface:
    """Read a surface from any format that trimesh reads; the numbers are taken as mm.

    The order and the count of the vertices stay as they are in the file. Only where the file repeats the
    corners of every triangle (STL) are identical points made one vertex, in the order they first appear.

    Raises InputError when the file is missing, cannot be read, has no triangles, or has a vertex that is not
    finite.
    """
    import trimesh  # heavy

    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; a surface file was expected")
    try:
        mesh = trimesh.load_mesh(path, process=False)
        vertices = np.array(mesh.vertices, dtype=np.float64)
        faces = np.array(mesh.faces, dtype=np.int32)
    except Exception as error:  # each format of trimesh fails with errors of its own
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{path}: cannot be read as a surface ({reason}); try PLY, STL, OBJ or OFF") from error
    surface = _merge_repeated_corners(vertices.reshape(-1, 3), faces.reshape(-1, 3))
    check_surface(surface, str(path))
    return surface


def write_surface(path: str | Path, surface: Surface) -> None:
    """Write a surface in the format of the name's ending, vertices in their order.

    PLY keeps float64, so that positions come back to the last bit; trimesh writes the other formats.

    Raises InputError when trimesh has no writer for the ending.
    """
    path = Path(path)
    if path.suffix.lower() == ".ply":
        path.write_bytes(_ply_bytes(surface))
        return
    import trimesh  # heavy

    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    try:
        mesh.export(path)
    except (ValueError, KeyError, NotImplementedError) as error:
        raise InputError(
            f"{path}: a surface cannot be written as '{path.suffix}' ({error}); try .ply or .stl"
        ) from error


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
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(
            f"{name}: triangles name vertices {faces.min()} to {faces.max()}, the surface has 0 to "
            f"{len(vertices) - 1}; repair the surface"
        )


def _merge_repeated_corners(vertices: np.ndarray, faces: np.ndarray) -> Surface:
    """One vertex for each distinct point, if no two triangles share a vertex as the file stands."""
    shares = len(faces) == 0 or len(np.unique(faces)) < faces.size
    if shares:
        return Surface(vertices, faces)
    _, first, inverse = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    in_file_order = np.argsort(first)
    number = np.empty(len(first), dtype=np.int32)
    number[in_file_order] = np.arange(len(first), dtype=np.int32)
    return Surface(vertices[first[in_file_order]], number[inverse.reshape(-1)][faces])


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
