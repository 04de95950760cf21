"""Back surface rotation (BSR): how far a horizontal section of the back is turned against the pelvis."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .outlines import outlines_of
from .spine import Spine, asis_axis, spine_of

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.geometry.surface import Surface

SPAN = 40.0
"""Least distance between the points where the dual tangent touches the back [mm]."""
BEYOND = 60.0
"""Length by which a drawn tangent extends past its points of contact [mm]."""
STEEPEST = math.radians(60.0)
"""A tangent turned further than this against the pelvis is not one of the back."""


class Contacts(NamedTuple):
    """Where a line touches the back: each point lies on an edge of the section's convex hull, or at its end."""

    points: np.ndarray
    """Left and right point from the spine [mm], shape (2, 2)."""
    edges: np.ndarray
    """The ends, left and right, of the edge that each lies on, from the spine [mm], shape (2, 2, 2)."""


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
    spine: np.ndarray
    """Centroid of the vertebra, x and y [mm], shape (2,)."""
    across: np.ndarray
    """Unit vector of the pelvis' axis to the patient's left, x and y, shape (2,)."""

    @property
    def line(self) -> np.ndarray:
        """The tangent as it is drawn, from the left to the right, `BEYOND` mm past its contacts, shape (2, 2)."""
        step = BEYOND * (self.left - self.right) / np.hypot(*(self.left - self.right))
        return np.array([self.left + step, self.right - step])


def back_surface_rotation(surface: Surface, landmarks: Landmarks) -> dict[str, DualTangent | None]:
    """The angle between the dual tangent to the posterior side of the section at each vertebra and the
    axis through the anterior superior iliac spines, in the axial plane (section 4.3.5 of [2]).

    A section lies at the height of its vertebra's centroid, the mean of the vertebra's landmarks; of several
    loops (arms beside the trunk) the one around the vertebra counts. Positive is a hump on the right: the
    right side of the back stands further back (+y) than the left, as seen in the axes of the pelvis. Turning
    the whole patient about z changes nothing.

    Args:
        surface: the skin [mm], closed.
        landmarks: those of the spine and the pelvis that go with this skin [mm].

    Returns:
        By level, top to bottom; None where the plane misses the trunk or finds no back behind the spine.

    Raises:
        InputError: 'asis_left' or 'asis_right' is missing or they coincide in the axial plane, or the surface
            is open where it is cut.
    """
    spine = spine_of(landmarks)
    return tangents_of(outlines_of(surface, spine)[0], spine, asis_axis(landmarks))


def tangents_of(
    outlines: Mapping[str, np.ndarray | None], spine: Spine, across: np.ndarray
) -> dict[str, DualTangent | None]:
    """The dual tangent by level, from the outlines of the trunk (`outlines_of`); None where there is none."""
    return {
        level: None if (outline := outlines[level]) is None else tangent_of(outline, centroid, across)
        for level, centroid in zip(spine.levels, spine.centroids, strict=True)
    }


def tangent_of(outline: np.ndarray, centroid: np.ndarray, across: np.ndarray) -> DualTangent | None:
    """The dual tangent of one section (points, 2), at the height of a vertebra's centroid (3,) [mm]."""
    touching = dual_tangent(outline, centroid[:2], across)
    if touching is None:
        return None
    left, right = touching
    angle = -math.degrees(turn(across, left - right))
    return DualTangent(float(centroid[2]), left, right, angle, outline, centroid[:2], across)


def dual_tangent(outline: np.ndarray, spine: np.ndarray, across: np.ndarray) -> np.ndarray | None:
    """Where the common tangent of the two sides of the back touches a section.

    With a groove along the spine it is the edge of the section's convex hull that bridges the spine, that is,
    the one met by the perpendicular from the spine. Where no edge of `SPAN` length bridges it, the back is
    convex there and every line of support touches it once; then it is the line through the points of the hull
    that lie `SPAN`/2 to either side of that perpendicular. So a section that is symmetric about an axis
    through the spine gives exactly the perpendicular of that axis, groove or not.

    Args:
        outline: closed loop without its first point repeated, shape (points, 2) [mm].
        spine: where the vertebra lies, shape (2,) [mm].
        across: unit vector from the patient's right to left, where the search for the perpendicular starts.

    Returns:
        Left and right points of contact, shape (2, 2), or None where there is no such line.
    """
    found = find_contacts(outline - spine, across)
    return None if found is None else found.points + spine


def find_contacts(outline: np.ndarray, across: np.ndarray) -> Contacts | None:
    """The contacts of `dual_tangent`, of an outline (points, 2) whose origin is the spine [mm]."""
    hull = _back_of_hull(outline, across)
    return None if hull is None else contacts_of(hull, across)


def contacts_of(hull: np.ndarray, across: np.ndarray, start: np.ndarray | None = None) -> Contacts | None:
    """The contacts of a hull's corners (n, 2) along the back, from left to right, from the spine [mm].

    `start` is a unit vector near the tangent; the search starts at `across` when it is left out.
    """
    direction = across if start is None else start
    touching = None
    for _ in range(100):  # the perpendicular depends on the tangent: a fixed point, reached in a few steps
        touching = _touching(hull, direction)
        if touching is None:
            return None
        tangent = touching.points[0] - touching.points[1]
        tangent = tangent / math.hypot(*tangent)
        turned = turn(direction, tangent)
        direction = tangent
        if abs(turn(across, direction)) > STEEPEST:
            return None
        if abs(turned) < 1e-10:
            break
    return touching


def turn(a: np.ndarray, b: np.ndarray) -> float:
    """Angle from a to b, counterclockwise [radians]."""
    return math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1])


def _back_of_hull(points: np.ndarray, across: np.ndarray) -> np.ndarray | None:
    """Corners of the convex hull of points (n, 2) where it faces the back within `STEEPEST`, left to right."""
    aside, back = points @ across, points @ np.array([-across[1], across[0]])
    sideways, backward = math.sin(STEEPEST) * aside, math.cos(STEEPEST) * back
    first, last = int(np.argmax(backward + sideways)), int(np.argmax(backward - sideways))
    if aside[first] <= aside[last]:
        return None
    between = np.flatnonzero((aside <= aside[first]) & (aside >= aside[last]))
    chain: list[int] = []  # the upper hull, from left to right (Andrew 1979)
    xs, ys = aside.tolist(), back.tolist()
    for i in between[np.lexsort((back[between], -aside[between]))].tolist():
        while len(chain) > 1:
            a, b = chain[-2:]
            if (xs[a] - xs[b]) * (ys[i] - ys[a]) < (ys[b] - ys[a]) * (xs[a] - xs[i]):
                break
            chain.pop()
        chain.append(i)
    return points[chain]


def _touching(hull: np.ndarray, across: np.ndarray) -> Contacts | None:
    """Where a line touches, the spine being the origin and the back perpendicular to `across`."""
    aside = hull @ across  # positive to the left; along the back the hull runs from left to right
    edge = _crossed(aside, 0.0)
    if edge is not None and math.dist(*hull[edge : edge + 2]) >= SPAN:
        ends = hull[edge : edge + 2]
        return Contacts(ends, np.stack([ends, ends]))
    edges, points = [], []
    for x in (SPAN / 2.0, -SPAN / 2.0):
        edge = _crossed(aside, x)
        if edge is None:
            return None
        start, end = hull[edge : edge + 2]
        edges.append((start, end))
        points.append(start + (aside[edge] - x) / (aside[edge] - aside[edge + 1]) * (end - start))
    return Contacts(np.array(points), np.array(edges))


def _crossed(aside: np.ndarray, x: float) -> int | None:
    """The edge of the back's side of the hull that crosses `aside` = x, by its left end; None if none does."""
    left = aside > x
    return next(iter(np.flatnonzero(left[:-1] & ~left[1:]).tolist()), None)
