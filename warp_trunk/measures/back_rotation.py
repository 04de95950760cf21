"""Back surface rotation (BSR): how far a horizontal section of the back is turned against the pelvis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..section import outer_loop, section

if TYPE_CHECKING:
    from ..landmarks import Landmarks
    from ..surface import Surface

SPAN = 40.0
"""Least distance between the points where the dual tangent touches the back [mm]."""
STEEPEST = math.radians(60.0)
"""A tangent turned further than this against the pelvis is not one of the back."""


@dataclass(frozen=True)
class DualTangent:
    """The line that touches the back on both sides of the spine at one vertebral level."""

    height: float
    """Height of the horizontal section [mm]."""
    left: np.ndarray
    """Point of contact on the patient's left, x and y [mm], shape (2,)."""
    right: np.ndarray
    """Point of contact on the patient's right, x and y [mm], shape (2,)."""
    angle: float
    """Back surface rotation [degrees], positive where the right side of the back stands further back."""
    outline: np.ndarray
    """The section of the trunk, x and y [mm], shape (points, 2), counterclockwise seen from above."""


def back_surface_rotation(surface: Surface, landmarks: Landmarks) -> dict[str, DualTangent | None]:
    """The angle between the dual tangent to the posterior side of the section at each vertebra and the
    axis through the anterior superior iliac spines, in the axial plane (section 4.3.5 of [2]).

    A section lies at the height of its vertebra's centroid, the mean of the vertebra's landmarks. Positive is
    a hump on the right: the right side of the back stands further back (+y) than the left, as seen in the
    axes of the pelvis. Turning the whole patient about z changes nothing.

    Args:
        surface: the skin [mm].
        landmarks: those of the spine and the pelvis that go with this skin [mm].

    Returns:
        By level, top to bottom; None where the plane misses the trunk or finds no back behind the spine.

    Raises:
        InputError: 'asis_left' or 'asis_right' is missing or they coincide in the axial plane.
    """
    across = asis_axis(landmarks)
    tangents: dict[str, DualTangent | None] = {}
    for level in landmarks.vertebrae():
        centroid = landmarks.of_bone(level).points.mean(axis=0)
        loops = section(surface, float(centroid[2]))
        outline = outer_loop(loops) if loops else None
        tangents[level] = None if outline is None else _measured(outline, centroid, across)
    return tangents


def asis_axis(landmarks: Landmarks) -> np.ndarray:
    """Unit vector in the axial plane from the right to the left anterior superior iliac spine, shape (2,)."""
    for name in ("asis_left", "asis_right"):
        if name not in landmarks.names:
            raise InputError(f"landmarks: '{name}' is missing; back surface rotation is measured against it")
    axis = landmarks.points[landmarks.index("asis_left")] - landmarks.points[landmarks.index("asis_right")]
    length = float(np.hypot(axis[0], axis[1]))
    if length < 1.0:
        raise InputError(
            f"landmarks: 'asis_left' and 'asis_right' are {length:.3g} mm apart seen from above; "
            "at least 1 mm is needed for an axis"
        )
    return axis[:2] / length


def dual_tangent(outline: np.ndarray, spine: np.ndarray, across: np.ndarray) -> np.ndarray | None:
    """Where the common tangent of the two sides of the back touches a section.

    With a groove along the spine it is the edge of the section's convex hull that bridges the spine, that is,
    the one met by the perpendicular from the spine. Where no edge of `SPAN` length bridges it, the back is
    convex there and every line of support touches it once; then it is the line that touches what remains of
    the section with `SPAN`/2 taken out on either side of that perpendicular. So a section that is symmetric
    about an axis through the spine gives exactly the perpendicular of that axis, groove or not.

    Args:
        outline: closed loop without its first point repeated, shape (points, 2) [mm].
        spine: where the vertebra lies, shape (2,) [mm].
        across: unit vector from the patient's right to left, where the search for the perpendicular starts.

    Returns:
        Left and right points of contact, shape (2, 2), or None where there is no such line.
    """
    start = direction = across
    touching = None
    for _ in range(100):  # the perpendicular depends on the tangent: a fixed point, reached in a few steps
        touching = _bridge(outline, spine, direction)
        if touching is None:
            return None
        tangent = touching[0] - touching[1]
        tangent = tangent / np.hypot(*tangent)
        turned = _angle(direction, tangent)
        direction = tangent
        if abs(_angle(start, direction)) > STEEPEST:
            return None
        if abs(turned) < 1e-10:
            break
    return touching


def _measured(outline: np.ndarray, centroid: np.ndarray, across: np.ndarray) -> DualTangent | None:
    touching = dual_tangent(outline, centroid[:2], across)
    if touching is None:
        return None
    left, right = touching
    angle = -math.degrees(_angle(across, left - right))
    return DualTangent(float(centroid[2]), left, right, angle, outline)


def _bridge(outline: np.ndarray, spine: np.ndarray, across: np.ndarray) -> np.ndarray | None:
    """Left and right points of the hull's edge behind the spine, the back being perpendicular to `across`."""
    axes = np.array([across, [-across[1], across[0]]])  # to the left and to the back
    points = (outline - spine) @ axes.T
    edge = _edge_over_zero(points)
    if edge is not None and np.hypot(*(edge[0] - edge[1])) < SPAN:
        half = SPAN / 2.0
        cuts = np.concatenate([_crossings(points, -half), _crossings(points, half)])
        edge = _edge_over_zero(np.concatenate([points[np.abs(points[:, 0]) >= half], cuts]))
    return None if edge is None else spine + edge @ axes


def _edge_over_zero(points: np.ndarray) -> np.ndarray | None:
    """The edge of the upper hull that spans x = 0, the end of larger x first, or None."""
    points = points[np.lexsort((points[:, 1], points[:, 0]))]
    hull: list[np.ndarray] = []
    for point in points:
        while len(hull) > 1 and _turns_left(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    for before, after in pairwise(hull):
        if before[0] <= 0.0 < after[0]:
            return np.array([after, before])
    return None


def _turns_left(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> bool:
    """Whether b lies below, or on, the line from a to c: then it is no corner of the upper hull."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) >= 0.0


def _crossings(points: np.ndarray, x: float) -> np.ndarray:
    """Where the closed loop crosses a line of constant x, shape (crossings, 2)."""
    after = np.roll(points, -1, axis=0)
    crossing = (points[:, 0] < x) != (after[:, 0] < x)
    a, b = points[crossing], after[crossing]
    part = (x - a[:, :1]) / (b[:, :1] - a[:, :1])
    crossings = a + part * (b - a)
    crossings[:, 0] = x
    return crossings


def _angle(a: np.ndarray, b: np.ndarray) -> float:
    """Angle from a to b, counterclockwise [radians]."""
    return math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1])
