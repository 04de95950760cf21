"""How results are drawn, apart from any viewer: colours, normals, sections and bars as plain arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..measures import DualTangent

SKIN = (229, 194, 172)
BONE = (236, 226, 198)
BEFORE = (120, 120, 120)
NOW = (0, 114, 178)
ACTUAL = (213, 94, 0)
"""Grey, blue and vermilion stay apart for every kind of colour vision."""
BAR = 0.36
"""Height of a bar, where levels are 1 apart."""
_CHANGE = np.array([[255, 246, 222], [253, 187, 132], [227, 74, 51], [127, 0, 0]], dtype=np.float64)


def change_colours(change: np.ndarray, most: float) -> np.ndarray:
    """Colours of distances [mm] on a scale from pale (0) over red to dark red (`most`), shape (n, 3), uint8.

    Lightness falls all the way, so that the scale reads in grey too.
    """
    part = np.clip(change / max(most, 1e-9), 0.0, 1.0) * (len(_CHANGE) - 1)
    channels = [np.interp(part, np.arange(len(_CHANGE)), _CHANGE[:, k]) for k in range(3)]
    return np.column_stack(channels).round().astype(np.uint8)


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals of vertices, the mean of their triangles weighted by area, shape (n, 3), float32."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)
    corners = faces.ravel()
    normals = np.column_stack([np.bincount(corners, np.repeat(area[:, k], 3), len(vertices)) for k in range(3)])
    return (normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]).astype(np.float32)


def seen_from_above(points: np.ndarray) -> np.ndarray:
    """Points (n, 2 or more) for a picture with x right and y down: patient's left on the left, back below."""
    return np.column_stack([-points[:, 0], points[:, 1]]).astype(np.float32)


def closed(loop: np.ndarray) -> np.ndarray:
    """A loop with its first point repeated at the end."""
    return np.vstack([loop, loop[:1]])


def tangent_line(tangent: DualTangent, beyond: float = 40.0) -> np.ndarray:
    """The dual tangent, reaching `beyond` mm past either point of contact, shape (2, 2)."""
    direction = tangent.left - tangent.right
    step = beyond * direction / np.hypot(*direction)
    return np.array([tangent.left + step, tangent.right - step])


def section_strips(tangents: dict[str, DualTangent | None]) -> list[np.ndarray]:
    """Outline and dual tangent of each level as curves in space, each (k, 3) float32."""
    strips = []
    for tangent in tangents.values():
        if tangent is not None:
            for curve in (closed(tangent.outline), tangent_line(tangent)):
                height = np.full(len(curve), tangent.height)
                strips.append(np.column_stack([curve, height]).astype(np.float32))
    return strips


def bars(angles: dict[str, float | None], place: int) -> list[np.ndarray]:
    """Horizontal bars of angles [degrees] as lines, one for each known level, the first level on top.

    Args:
        angles: by level; a missing one leaves its place empty.
        place: 0 for the upper of the two bars that share a level, 1 for the lower.

    Returns:
        Lines from zero to the angle, each (2, 2) float32: angle, and level counted from the top.
    """
    return [
        np.array([[0.0, row + BAR * (place - 0.5)], [angle, row + BAR * (place - 0.5)]], np.float32)
        for row, angle in enumerate(angles.values())
        if angle is not None
    ]
