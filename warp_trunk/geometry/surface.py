"""A triangulated surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warp_trunk.errors import InputError

FARTHEST = 1e7
"""No coordinate is farther from zero than this, in any unit; sums of cubes of such numbers stay exact enough."""


@dataclass(frozen=True)
class Surface:
    """Triangles in patient axes (LPS: +x left, +y back, +z up).

    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    >>> len(wt.Surface(corners, np.array([[0, 1, 2]], dtype=np.int32)).faces)
    1
    """

    vertices: np.ndarray
    """Positions [mm], shape (vertices, 3), float64."""
    faces: np.ndarray
    """Vertex indices, counterclockwise seen from outside, shape (faces, 3), int32."""


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
            f"{name}: {bad.size} of {len(vertices)} vertices are not finite, the first is number {bad[0]}, "
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
