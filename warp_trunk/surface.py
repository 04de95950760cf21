"""A triangulated surface, and reading and writing one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Surface:
    """Triangles in patient axes (LPS: +x left, +y back, +z up)."""

    vertices: np.ndarray
    """Positions [mm], shape (vertices, 3), float64."""
    faces: np.ndarray
    """Vertex indices, counterclockwise seen from outside, shape (faces, 3), int32."""
