"""A triangulated surface, its normals and areas, and the digests by which large inputs are compared."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np

from warp_trunk.checking import Array, check_fields
from warp_trunk.errors import InputError

if TYPE_CHECKING:
    from scipy.sparse import csr_array

FARTHEST = 1e7
"""No coordinate is farther from zero than this, in any unit; sums of cubes of such numbers stay exact enough."""


@dataclass(frozen=True, eq=False, repr=False)
class Surface:
    """Triangles in patient axes (LPS: +x left, +y back, +z up).

    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    >>> len(wt.Surface(corners, np.array([[0, 1, 2]], dtype=np.int32)).faces)
    1
    """

    vertices: Annotated[np.ndarray, Array(None, 3, finite=False)]
    """Positions [mm], shape (vertices, 3), float64."""
    faces: Annotated[np.ndarray, Array(None, 3, kind=np.int32)]
    """Vertex indices, counterclockwise seen from outside, shape (faces, 3), int32."""
    colours: Annotated[np.ndarray, Array(None, 3, kind=np.uint8)] | None = None
    """Red, green and blue of each vertex, as pictures have them, shape (vertices, 3), uint8; None without any."""

    def __post_init__(self) -> None:
        """Takes lists too; raises InputError for what is no array of this kind and shape."""
        check_fields(self, "surface")
        if self.colours is not None and len(self.colours) != len(self.vertices):
            counts = f"{len(self.colours)} for {len(self.vertices)} vertices"
            raise InputError(f"surface: 'colours' must have a row for each vertex, not {counts}; correct it")

    def __repr__(self) -> str:
        coloured = "" if self.colours is None else ", coloured"
        return f"Surface({len(self.vertices)} vertices, {len(self.faces)} triangles{coloured})"

    def moved(self, vertices: np.ndarray) -> Surface:
        """The same triangles and colours with vertices at other places [mm], shape (vertices, 3)."""
        return replace(self, vertices=vertices)


def compact(vertices: np.ndarray, faces: np.ndarray) -> Surface:
    """The surface of some faces (n, 3) with only those of the vertices (m, 3) that they use."""
    used, faces = np.unique(faces, return_inverse=True)
    return Surface(vertices[used], faces.reshape(-1, 3).astype(np.int32))


def directed_edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First and second vertex of each side of triangles (n, 3) in their direction, shape (3 n,) each, int64."""
    faces = faces.astype(np.int64)
    return faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)


def shared_edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges of two triangles each: their vertices and these triangles, shape (edges, 2) each.

    To import trimesh, which has them too, takes a twentieth of a simulation."""
    first, second = directed_edges(faces)
    low, high = np.minimum(first, second), np.maximum(first, second)
    edge = low * (first.max(initial=0) + 1) + high
    order = np.argsort(edge, kind="stable")
    twice = np.flatnonzero(np.diff(edge[order]) == 0)
    sides = np.stack([order[twice], order[twice + 1]], axis=1)
    return np.stack([low, high], axis=1)[sides[:, 0]], sides // 3


def bends(surface: Surface, pairs: np.ndarray) -> np.ndarray:
    """Angle between the normals of two triangles [degrees], from 0, for each of `pairs`, shape (pairs,)."""
    first, second = np.moveaxis(unit(area_vectors(surface.vertices, surface.faces))[pairs], 1, 0)
    sine = np.linalg.norm(np.cross(first, second), axis=1)  # exact for small angles, where the cosine is not
    return np.degrees(np.arctan2(sine, np.einsum("ij,ij->i", first, second)))


def neighbour_means(surface: Surface) -> csr_array:
    """The matrix that takes values at vertices to their means over the neighbours, shape (vertices, vertices)."""
    from scipy.sparse import csr_array, diags_array  # heavy

    ends, count = directed_edges(surface.faces), len(surface.vertices)
    beside = csr_array((np.ones(len(ends[0])), ends), shape=(count, count))
    return csr_array(diags_array(1.0 / np.maximum(beside.sum(axis=1), 1.0)) @ beside)


def area_vectors(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Outward normal of each triangle (faces, 3), of the length of its area [mm^2]; zero for one without area."""
    along = np.ascontiguousarray(vertices.T)  # NumPy works several times as fast on long rows
    a, b, c = (along.take(corner, axis=1) for corner in faces.T)
    return np.ascontiguousarray(0.5 * np.cross(b - a, c - a, axis=0).T)


def area_centre(surface: Surface) -> np.ndarray:
    """The centroid of a surface's area, wherever its vertices are dense [mm], shape (3,)."""
    area = np.linalg.norm(area_vectors(surface.vertices, surface.faces), axis=1)
    return area @ surface.vertices[surface.faces].mean(axis=1) / area.sum()


def unit(vectors: np.ndarray) -> np.ndarray:
    """The vectors (..., n) at length 1; one without length stays as it is."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)


def vertex_areas(surface: Surface) -> np.ndarray:
    """A third of the area vectors [mm^2] of the triangles around each vertex, shape (vertices, 3)."""
    third = np.repeat(area_vectors(surface.vertices, surface.faces).T / 3.0, 3, axis=1)
    corner, count = surface.faces.reshape(-1), len(surface.vertices)
    return np.column_stack([np.bincount(corner, along, count) for along in third])


def vertex_normals(surface: Surface) -> np.ndarray:
    """Unit normals of the vertices: the mean of the triangles at each, weighted by area, shape (vertices, 3)."""
    return unit(vertex_areas(surface))


def corner_areas(surface: Surface) -> np.ndarray:
    """The area of surface around each vertex, a third of its triangles [mm2], shape (vertices,)."""
    third = np.repeat(np.linalg.norm(area_vectors(surface.vertices, surface.faces), axis=1) / 3.0, 3)
    return np.bincount(surface.faces.reshape(-1), third, len(surface.vertices))


def side_lengths(surface: Surface) -> np.ndarray:
    """The lengths of the sides of each triangle [mm], shape (faces, 3)."""
    corners = surface.vertices[surface.faces]
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)


def check_surface(surface: Surface, name: str) -> None:
    """Check that a surface has triangles, finite vertices, and faces that name vertices it has.

    Raises InputError whose text starts with `name`.
    """
    vertices, faces = surface.vertices, surface.faces
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    fault = None
    if len(vertices) == 0 or len(faces) == 0:
        fault = f"the surface is empty ({len(vertices)} vertices, {len(faces)} triangles)"
    elif bad.size:
        first = f"the first is number {bad[0]}, {vertices[bad[0]].tolist()}"
        fault = f"{bad.size} of {len(vertices)} vertices are not finite, {first}"
    elif (far := np.abs(vertices).max()) > FARTHEST:
        fault = f"a vertex is at {far:.3g}, coordinates may be {FARTHEST:g} at most"
    elif faces.min() < 0 or faces.max() >= len(vertices):
        fault = f"triangles name vertices {faces.min()} to {faces.max()}, the surface has 0 to {len(vertices) - 1}"
    if fault:
        raise InputError(f"{name}: {fault}; repair the surface")


def digest(*parts: np.ndarray | str | bytes) -> str:
    """A digest of arrays with their types and shapes, of texts and of bytes, in hexadecimal."""
    hasher = hashlib.blake2b(digest_size=20)
    for part in parts:
        if isinstance(part, np.ndarray):
            hasher.update(f"{part.dtype.str} {part.shape}".encode())
            hasher.update(np.ascontiguousarray(part).tobytes())
        else:
            hasher.update(part.encode() if isinstance(part, str) else part)
    return hasher.hexdigest()


def short_digest(*parts: np.ndarray | str | bytes) -> str:
    """The first twelve figures of a digest in groups of four: a name that is compared on paper."""
    name = digest(*parts)
    return "-".join(name[first : first + 4] for first in (0, 4, 8))


def surface_digest(surface: Surface) -> str:
    """The digest of every vertex and face of a surface."""
    return digest(surface.vertices, surface.faces)
