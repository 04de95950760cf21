"""The back in horizontal sections: how far it is turned against the pelvis (BSR), and the height of its hump."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.section import turn, upper_hull
from warp_trunk.geometry.surface import Surface
from warp_trunk.spine.spine import Spine, asis_axis, spine_of

from .outlines import outlines_of

SPAN = 40.0
"""Least distance between the points where the dual tangent touches the back [mm]."""
BESIDE = 10.0
"""An edge that the perpendicular from the spine misses by more than this does not bridge the spine [mm]."""
BEYOND = 60.0
"""Length by which a drawn tangent extends past its points of contact [mm]."""
UNSURE_PLACE = 10.0
"""Standard deviation of the place of a spinous process that a line of vertebral bodies gives [mm]."""
LONGER = 1.25
"""A bridge that is longer than `SPAN` by this factor is one for another choice of `SPAN`, too."""
DEPENDS = 0.8
"""Change of a rotation with the place of the spine from which on the back does not determine it [degrees]."""
HUMP_DEPENDS = 5.0
"""Change of a hump with the place of the spine from which on the back does not determine it [mm]: where the spine
is beside the middle of the trunk, its mirror image falls down the flank. Of a patient whose back is turned by 4.5
degrees at T11 the hump was 29 mm, and 16 mm with the spine 10 mm aside."""
STEEPEST = math.radians(60.0)
"""A tangent turned further than this against the pelvis is not one of the back."""


class Contacts(NamedTuple):
    """Where a line touches the back: each point lies on an edge of the section's convex hull, or at its end."""

    points: np.ndarray
    """Left and right point [mm], shape (2, 2)."""
    edges: np.ndarray
    """The ends, left and right, of the edge that each lies on [mm], shape (2, 2, 2)."""
    nearest: np.ndarray
    """The ends of the edge nearest to the spine [mm], shape (2, 2); the one edge where a single one bridges it."""


@dataclass(frozen=True)
class DualTangent:
    """The line that touches the back on both sides of the spine at one vertebral level."""

    height: float
    """Height of the horizontal section [mm]."""
    contacts: Contacts
    """Where it touches the back."""
    angle: float
    """Back surface rotation [degrees], positive where the right side of the back stands further back."""
    outline: np.ndarray
    """The section of the trunk, x and y [mm], shape (points, 2), counterclockwise seen from above."""
    spine: np.ndarray
    """Centroid of the vertebra, x and y [mm], shape (2,)."""
    across: np.ndarray
    """Unit vector of the pelvis' axis to the patient's left, x and y, shape (2,)."""
    seen: np.ndarray | None = None
    """Which points of the outline a scan showed, which alone the tangent touches, bool, shape (points,); None for
    all of them."""

    @property
    def back(self) -> np.ndarray:
        """The points of the outline that the tangent may touch [mm], shape (m, 2)."""
        return self.outline if self.seen is None else self.outline[self.seen]

    @property
    def left(self) -> np.ndarray:
        """Point of contact on the patient's left, x and y [mm], shape (2,)."""
        return self.contacts.points[0]

    @property
    def right(self) -> np.ndarray:
        """Point of contact on the patient's right, x and y [mm], shape (2,)."""
        return self.contacts.points[1]

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
    outlines: Mapping[str, np.ndarray | None],
    spine: Spine,
    across: np.ndarray,
    seen: Mapping[str, np.ndarray] | None = None,
) -> dict[str, DualTangent | None]:
    """The dual tangent by level, from the outlines of the trunk (`outlines_of`); None where there is none.

    Args:
        outlines: by level, shape (points, 2) [mm].
        spine: vertebrae.
        across: unit vector of the pelvis' axis to the left, shape (2,).
        seen: by level which points of an outline a scan showed, bool, shape (points,); all of them when left out.
    """
    return {
        level: None
        if (outline := outlines[level]) is None
        else tangent_of(outline, centroid, across, None if seen is None else seen[level])
        for level, centroid in zip(spine.levels, spine.centroids, strict=True)
    }


ROUND = "the back is round there, as a nape or hair is, and the rotation depends on the exact place of the spine"
"""Why a rotation is missing that the back does not determine."""


def is_determined(tangent: DualTangent, place: float = UNSURE_PLACE) -> bool:
    """Whether the back determines its rotation: it changes by less than `DEPENDS` if the spine lies elsewhere.

    Where no edge bridges the spine, the rotation is that of the back behind it, and a nape whose radius is 70 mm
    turns by 8 degrees over 10 mm. Of 20 patients 19 have such a T1, eight such a T2, and hardly one such a
    level at T3 to L1. A bridge that is hardly longer than `SPAN` comes and goes with the place, too.

    Args:
        tangent: of a level.
        place: how far to either side the spine may lie [mm].
    """
    for aside in (-place, 0.0, place):
        for span in (SPAN, LONGER * SPAN):
            moved = find_contacts(tangent.back, tangent.spine + aside * tangent.across, tangent.across, span)
            if moved is None:
                return False
            angle = -math.degrees(turn(tangent.across, moved.points[0] - moved.points[1]))
            if abs(angle - tangent.angle) > DEPENDS:
                return False
    return True


def tangent_of(
    outline: np.ndarray, centroid: np.ndarray, across: np.ndarray, seen: np.ndarray | None = None
) -> DualTangent | None:
    """The dual tangent of one section (points, 2), at the height of a vertebra's centroid (3,) [mm]; it touches
    points that were seen only, bool, shape (points,)."""
    back = outline if seen is None else outline[seen]
    contacts = find_contacts(back, centroid[:2], across) if len(back) else None
    return None if contacts is None else tangent_at(outline, centroid, across, contacts, seen)


def tangent_at(
    outline: np.ndarray,
    centroid: np.ndarray,
    across: np.ndarray,
    contacts: Contacts,
    seen: np.ndarray | None = None,
) -> DualTangent:
    """The dual tangent of one section with its contacts; other arguments as for `tangent_of`."""
    angle = -math.degrees(turn(across, contacts.points[0] - contacts.points[1]))
    return DualTangent(float(centroid[2]), contacts, angle, outline, centroid[:2], across, seen)


def find_contacts(
    outline: np.ndarray, spine: np.ndarray, across: np.ndarray, span: float = SPAN
) -> Contacts | None:
    """Where the common tangent of the two sides of the back touches a section.

    With a groove along the spine it is the edge of the section's convex hull that bridges the spine: of the edges
    of `SPAN` length or more the one that the perpendicular from the spine meets or misses by the least, by
    `BESIDE` at most: a spinous process stands beside the perpendicular from a turned vertebra, and one of 340
    sections of real backs needs more. An edge over a hollow of the flank misses it by more, and would turn the
    back by up to 8 degrees. Each edge is judged by its own perpendicular: one that is followed from tangent to
    tangent, from a vertebra 100 mm in front of the skin, runs away to the flank on real lumbar backs.

    Where no edge bridges the spine, the back is convex there and every line of support touches it once; then it is
    the line through the points of the hull that lie `SPAN`/2 to either side of its perpendicular from the spine,
    which may leave the hull's point nearest to the spine by `SPAN`/2. So a section that is symmetric about an axis
    through the spine gives exactly the perpendicular of that axis, groove or not.

    Args:
        outline: closed loop without its first point repeated, or the back alone, shape (points, 2) [mm].
        spine: where the vertebra or its spinous process lies, shape (2,) [mm].
        across: unit vector from the patient's right to left; it says which side of the section is the back.
        span: least length of a bridge [mm].

    Returns:
        The points of contact, or None where there is no such line.
    """
    hull = _back_of_hull(outline, across)
    if hull is None:
        return None
    from_spine = hull - spine
    edges = np.stack([hull[:-1], hull[1:]], axis=1)  # each from left to right
    way = hull[:-1] - hull[1:]
    length = np.hypot(*way.T)
    way /= length[:, None]
    left, right = (np.einsum("ij,ij->i", end, way) for end in (from_spine[:-1], from_spine[1:]))
    missed = np.where(length >= span, np.maximum(np.maximum(-left, right), 0.0), np.inf)
    away = np.hypot(*(from_spine[:-1] - np.clip(left, 0.0, length)[:, None] * way).T)
    if missed.min() <= BESIDE:
        bridge = edges[np.lexsort([away, missed])[0]]
        return Contacts(bridge, np.stack([bridge, bridge]), bridge)

    def beside(along: np.ndarray, places: np.ndarray) -> np.ndarray | None:
        aside = from_spine @ along  # positive to the left; along the back the hull runs from left to right
        crossed = [np.flatnonzero((aside[:-1] > x) & (aside[1:] <= x)) for x in places]
        return np.array([edges[crossings[0]] for crossings in crossed]) if all(map(len, crossed)) else None

    return contacts_beside(spine, edges[away.argmin()], beside)


def contacts_beside(
    spine: np.ndarray, nearest: np.ndarray, beside: Callable[[np.ndarray, np.ndarray], np.ndarray | None]
) -> Contacts | None:
    """The contacts of a convex back, `SPAN`/2 to either side of the perpendicular from the spine (2,) [mm].

    Args:
        spine: where the vertebra lies, shape (2,) [mm].
        nearest: left and right end of the edge of the hull nearest to it, shape (2, 2) [mm].
        beside: the edges that are crossed, shape (2, 2, 2), from a unit vector along the tangent and the places
            along it where they are, from the spine, shape (2,) [mm]; None where the back ends before them.
    """
    along = nearest[0] - nearest[1]
    length = math.hypot(*along)
    along = along / length
    place = nearest[1] + min(max((spine - nearest[1]) @ along, 0.0), length) * along
    contacts = None
    for _ in range(100):  # the perpendicular depends on the tangent: a fixed point, reached in a few steps
        straight = (place - spine) @ along
        places = min(max(0.0, straight - SPAN / 2.0), straight + SPAN / 2.0) + np.array([SPAN / 2.0, -SPAN / 2.0])
        edges = beside(along, places)
        if edges is None:
            return None
        start, end = edges[:, 0], edges[:, 1]
        share = ((start - spine) @ along - places) / ((start - end) @ along)
        contacts = Contacts(start + share[:, None] * (end - start), edges, nearest)
        tangent = (contacts.points[0] - contacts.points[1]) / math.dist(*contacts.points)
        turned = turn(along, tangent)
        along = tangent
        if abs(turned) < 1e-10:
            break
    return contacts


def _back_of_hull(points: np.ndarray, across: np.ndarray) -> np.ndarray | None:
    """Corners of the convex hull of points (n, 2) where it faces the back within `STEEPEST`, left to right."""
    aside, back = points @ across, points @ np.array([-across[1], across[0]])
    sideways, backward = math.sin(STEEPEST) * aside, math.cos(STEEPEST) * back
    first, last = int(np.argmax(backward + sideways)), int(np.argmax(backward - sideways))
    if aside[first] <= aside[last]:
        return None
    between = np.flatnonzero((aside <= aside[first]) & (aside >= aside[last]))
    order = between[np.lexsort((back[between], -aside[between]))]
    return points[order[upper_hull(-aside[order], back[order])]]


def hump_height(tangent: DualTangent) -> float | None:
    """Height of the top of the hump over the other side of the back, as far from the spine [mm].

    The top is the point furthest back, perpendicular to the pelvis' axis, from `SPAN`/2 beside the vertebra to
    where the first side of the back turns by 45 degrees towards the flank. Its height over the opposite side is
    the hump and the depression added up (Thulbourne and Gillespie, J Bone Joint Surg Br 1976, 58:64), what the
    level bar of a humpmeter reads (Ferraro et al., Eur J Phys Rehabil Med 2017, 53:377); standing here, and not
    bending forward.

    Returns:
        Millimetres, positive for a hump on the right; None where the back is narrower than `SPAN`.
    """
    top = hump_top(tangent)
    return None if top is None else top[0]


FLANK = "it is compared with the flank, and depends on the exact place of the spine"
"""Why a hump is missing that the back does not determine."""


def is_hump_determined(tangent: DualTangent, place: float = UNSURE_PLACE) -> bool:
    """Whether the hump changes by less than `HUMP_DEPENDS` if the spine lies elsewhere.

    Args:
        tangent: of a level.
        place: how far to either side the spine may lie [mm].
    """
    height = hump_height(tangent)
    for aside in (-place, place):
        moved = hump_height(replace(tangent, spine=tangent.spine + aside * tangent.across))
        if height is None or moved is None or abs(moved - height) > HUMP_DEPENDS:
            return False
    return True


def hump_top(tangent: DualTangent) -> tuple[float, np.ndarray] | None:
    """The height of the hump [mm], and its place on the right of the spine and as far from it on the left, x and y
    [mm], shape (2, 2); None where the back is narrower than `SPAN`."""
    behind = np.array([-tangent.across[1], tangent.across[0]])
    points = tangent.outline - tangent.spine
    aside, back = points @ tangent.across, points @ behind
    first, last = int(np.argmax(back + aside)), int(np.argmax(back - aside))
    reach = min(aside[first], -aside[last])
    if reach < SPAN / 2.0:
        return None
    along = np.arange(first, last + 1 if last >= first else last + 1 + len(points)) % len(points)
    to_right = np.maximum.accumulate(-aside[along])  # where the outline folds back on itself, its outer part
    corners = np.abs(to_right)
    distances = np.append(corners[(corners > SPAN / 2.0) & (corners < reach)], [SPAN / 2.0, reach])
    right, left = (np.interp(side * distances, to_right, back[along]) for side in (1.0, -1.0))
    top = int(np.argmax(np.maximum(right, left)))
    places = np.outer([-distances[top], distances[top]], tangent.across) + np.outer(
        [right[top], left[top]], behind
    )
    return float(right[top] - left[top]), tangent.spine + places
