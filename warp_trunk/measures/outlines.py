"""The outlines of the trunk: its sections, the widths of its flanks, its waist and its shoulders."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from warp_trunk.geometry.section import SHOULDERS, own_part, sections, trunk_loop, upper_hull
from warp_trunk.geometry.surface import Surface, directed_edges
from warp_trunk.spine.spine import SacralLine, Spine


def outlines_of(surface: Surface, spine: Spine) -> tuple[dict[str, np.ndarray | None], dict[str, str]]:
    """Outline of the trunk at the height of each vertebra's centroid; of several loops the one around it,
    and where arms touch the trunk (`own_part`) without them.

    Args:
        surface: the skin [mm], closed.
        spine: vertebrae [mm].

    Returns:
        By level, top to bottom: x and y [mm], shape (points, 2), counterclockwise seen from above, or None where
        it is missing; and why, for those.

    Raises:
        InputError: the surface is open where it is cut.
    """
    outlines: dict[str, np.ndarray | None] = {}
    missing: dict[str, str] = {}
    cuts = sections(surface, spine.centroids[:, 2].tolist())
    for level, centroid, loops in zip(spine.levels, spine.centroids, cuts, strict=True):
        outline = trunk_loop(loops, centroid[:2])
        own = None if outline is None or level in SHOULDERS else own_part(outline, centroid[:2])
        outlines[level] = outline = outline if own is None else own
        if not loops:
            missing[level] = f"the plane at z = {centroid[2]:.0f} mm misses the skin"
        elif outline is None:
            missing[level] = f"no part of the section at z = {centroid[2]:.0f} mm goes round the vertebra"
    return outlines, missing


@dataclass(frozen=True)
class FlankAsymmetry:
    """Widths of one level of the trunk, along the pelvis' axis."""

    left: float
    """From the sacral line to the left flank [mm]."""
    right: float
    """From the sacral line to the right flank [mm]."""

    @property
    def index(self) -> float:
        """Difference of the widths in percent of the whole, positive where the right one is wider."""
        return 100.0 * (self.right - self.left) / (self.right + self.left)


def flank_asymmetry(outline: np.ndarray, line: SacralLine) -> FlankAsymmetry:
    """How far the two flanks of a level are from the central sacral vertical line.

    The frontal asymmetry index of POTSI, the posterior trunk symmetry index (Suzuki et al., Stud Health Technol
    Inform 1999, 59:81), which takes it at the armpits and the waist; here it is known at every level and keeps
    its sign. Where the arms of a skin are cut off, the cut is its flank.

    Args:
        outline: section of the trunk, x and y [mm], shape (points, 2).
        line: see `sacral_line`.
    """
    to_left = (outline - line.point) @ line.across
    return FlankAsymmetry(left=float(to_left.max()), right=-float(to_left.min()))


CHEST = "T8"
"""The outline is taken from this vertebra, below the armpits, ..."""
BELOW = 40.0
"""... to this far below the iliac spines, where the hips are wide [mm]."""
UPPER = "T12"
"""The waist lies below this vertebra, whose ribs are the lowest, and above the iliac spines. A hollow above it is
one of the chest, in a thoracic curve the deepest on the concave side."""
HEIGHT_STEP = 8.0
"""Distance of the heights at which it is taken [mm]."""
SHALLOW = 1.0
"""A side whose outline is straight to within this has no hollow, and no height of one [mm]."""


@dataclass(frozen=True)
class Waist:
    """The hollow between chest and hip on either side, seen from behind."""

    left_depth: float
    """Largest distance of the left outline from the line that touches chest and hip, sideways,
    between ribs and pelvis [mm]."""
    right_depth: float
    """The same on the right [mm]."""
    left_height: float
    """Height of the hollow on the left above the iliac spines, its mean by the square of its depth [mm]: the
    deepest point alone jumps along a long hollow; 0 without a hollow (`SHALLOW`)."""
    right_height: float
    """The same on the right [mm]."""
    left_angle: float
    """Angle at the deepest point on the left between the lines that touch chest and hip [degrees]."""
    right_angle: float
    """The same on the right [degrees]."""
    height_angle: float
    """Angle of the line between both hollows, at their heights, against the horizontal [degrees], positive where
    the right one is higher."""

    @property
    def angle_ratio(self) -> float:
        """Waist angle ratio: the right angle over the left one [%]."""
        return 100.0 * self.right_angle / self.left_angle

    @property
    def depth_ratio(self) -> float | None:
        """Waistline depth ratio: the left depth over the right one [%]; None without a right waist."""
        return 100.0 * self.left_depth / self.right_depth if self.right_depth > 0.0 else None

    @property
    def depth_difference(self) -> float:
        """How much deeper the right waist is [mm]."""
        return self.right_depth - self.left_depth

    @property
    def height_difference(self) -> float:
        """How much higher the right waist is [mm]."""
        return self.right_height - self.left_height


@dataclass(frozen=True, eq=False)
class Silhouette:
    """The outline of the trunk from behind, from the hips to the chest."""

    heights: np.ndarray
    """Where it is taken [mm], shape (heights,)."""
    widths: np.ndarray
    """How far the skin reaches to the left and to the right of the sacral line there [mm], shape (2, heights)."""
    edges: np.ndarray
    """The two vertices of the edge that reaches so far, shape (2, heights, 2)."""
    pelvis: float
    """Height of the iliac spines [mm]."""
    top: float
    """Height below which the waist lies [mm]."""


def silhouette_of(skin: Surface, spine: Spine, line: SacralLine, pelvis: float) -> Silhouette | None:
    """The silhouette for `waist_of`, with the same arguments; None where it is missing."""
    if not {CHEST, UPPER} <= set(spine.levels):
        return None
    top, upper = (float(spine.centroids[spine.levels.index(name), 2]) for name in (CHEST, UPPER))
    heights = np.arange(max(pelvis - BELOW, skin.vertices[:, 2].min() + 1.0), top, HEIGHT_STEP)
    if len(heights) < 5 or heights[0] > pelvis:
        return None
    aside, z = (skin.vertices[:, :2] - line.point) @ line.across, skin.vertices[:, 2]
    start, end = directed_edges(skin.faces)
    above = np.searchsorted(heights, z)  # the first height that is not below each vertex
    low, high = np.minimum(above[start], above[end]), np.maximum(above[start], above[end])
    cut = np.flatnonzero(low < high)
    count = (high - low)[cut]
    edge = np.repeat(cut, count)
    row = np.repeat(low[cut] - np.cumsum(count) + count, count) + np.arange(count.sum())
    a, b = start[edge], end[edge]
    aside_at_height = aside[a] + (heights[row] - z[a]) / (z[b] - z[a]) * (aside[b] - aside[a])
    if len(np.unique(row)) < len(heights):  # no skin at a height
        return None
    orders = [np.lexsort((side, row)) for side in (aside_at_height, -aside_at_height)]
    outer = np.array(
        [order[np.searchsorted(row[order], np.arange(len(heights)), "right") - 1] for order in orders]
    )
    edges = np.stack([a[outer], b[outer]], axis=2)
    return Silhouette(heights, aside_at_height[outer] * [[1.0], [-1.0]], edges, pelvis, upper)


def waist_of(skin: Surface, spine: Spine, line: SacralLine, pelvis: float) -> Waist | None:
    """Depth and height of the waist on either side.

    The outline is that of the silhouette from behind: at each height the skin furthest along the pelvis' axis.
    The line that touches chest and hip is the edge of the outline's convex hull, so that no point of either has to
    be chosen; what is hollow between ribs and pelvis is the waist. Differences of the heights and the depths of
    both sides are two of the six parts of POTSI, the posterior trunk symmetry index (Suzuki et al., Stud Health
    Technol Inform 1999, 59:81), in millimetres. Waist angles and height angle are those of photographs (Matamalas
    et al., Eur Spine J 2016, 25:3170), with chest and hip where lines from the deepest point touch them. Their
    ratio is right over left and that of the depths left over right: both are then below 1 in lumbar curves to the
    left, as published (Spine Deform 2024, PMID 38526692, whose abstract leaves the sides open).

    Args:
        skin: the skin, its arms cut off or raised [mm].
        spine: vertebrae, T8 and T12 among them [mm].
        line: the sacral line, from which widths are taken.
        pelvis: height of the iliac spines [mm].

    Returns:
        None without these, or where the skin ends above the hips.
    """
    outline = silhouette_of(skin, spine, line, pelvis)
    return None if outline is None else hollows(outline)


def hollows(outline: Silhouette) -> Waist:
    """The waist of a silhouette, see `waist_of`."""
    heights, widths, pelvis = outline.heights, outline.widths, outline.pelvis
    hulls = [(width, upper_hull(heights, width)) for width in widths]
    gaps = np.transpose([np.interp(heights, heights[hull], width[hull]) - width for width, hull in hulls])
    gaps[(heights < pelvis) | (heights > outline.top)] = 0.0
    weights, hollow = np.square(gaps).sum(axis=0), gaps.max(axis=0) > SHALLOW
    left, right = np.divide((heights - pelvis) @ np.square(gaps), weights, out=np.zeros(2), where=hollow)
    deepest = gaps.argmax(axis=0)
    angles = [_angle_at(int(row), heights, width) for row, width in zip(deepest, widths, strict=True)]
    rows = np.arange(2), deepest
    apart = float(widths[rows].sum())
    return Waist(
        left_depth=float(gaps[:, 0].max()),
        right_depth=float(gaps[:, 1].max()),
        left_height=float(left),
        right_height=float(right),
        left_angle=angles[0],
        right_angle=angles[1],
        height_angle=math.degrees(math.atan2(right - left, apart)),
    )


def _angle_at(row: int, heights: np.ndarray, widths: np.ndarray) -> float:
    """Angle at a point of an outline between the lines that touch it above and below [degrees]; 180 at an end."""
    other_rows = np.arange(len(heights)) != row
    rise = (widths[other_rows] - widths[row]) / np.abs(heights[other_rows] - heights[row])
    sides = rise[:row], rise[row:]
    if not all(map(len, sides)):
        return 180.0
    return 180.0 - sum(math.degrees(math.atan(float(side.max()))) for side in sides)


DEEP = 100.0
"""Skin lower than this below T1 belongs to no shoulder [mm]."""
INNER, OUTER = 0.6, 0.8
"""Between these parts of the way from the neck's middle to the edge of the shoulder its height is taken."""
PLACES = 9
"""At how many places between them."""


@dataclass(frozen=True)
class Shoulders:
    """The tops of the two shoulders, as the skin shows them from the front or from behind."""

    left: float
    """Mean height of the left shoulder above the centroid of T1 [mm]."""
    right: float
    """Mean height of the right shoulder above the centroid of T1 [mm]."""

    inner: float
    """Where the heights were taken: from this distance beside T1 [mm] ..."""
    outer: float
    """... to this one [mm]."""

    @property
    def angle(self) -> float:
        """Angle of the line over both shoulders against the horizontal [degrees], positive where the right one
        stands higher."""
        return math.degrees(math.atan2(self.difference, self.inner + self.outer))

    @property
    def difference(self) -> float:
        """How much higher the right shoulder stands [mm], negative where the left one does."""
        return self.right - self.left


@dataclass(frozen=True, eq=False)
class UpperOutline:
    """The upper outline of the trunk beside T1: at each place the edge of the skin that is highest there."""

    edge: int
    """The vertex at the edge of the narrower shoulder, from which distances are taken."""
    reach: float
    """Its distance from T1 along the pelvis' axis [mm]."""
    heights: np.ndarray
    """Heights of the places above the centroid of T1, left and right [mm], shape (2, PLACES)."""
    ends: np.ndarray
    """The two vertices of the highest edge at each place, shape (2, PLACES, 2)."""


def shoulder_heights(skin: Surface, spine: Spine, across: np.ndarray) -> Shoulders | None:
    """How high the upper outline of the trunk stands on either side, at the same distances from T1.

    The height of a place is that of the highest skin on the vertical plane through it, perpendicular to the
    pelvis' axis. It is averaged from `INNER` to `OUTER` of the distance to the edge of the narrower shoulder:
    beyond the neck, over the outer half of the clavicle. Radiographic shoulder height takes the same outline, the
    shadow of the skin, above the acromioclavicular joints (Kuklo et al., Spine 2002, 27:2013), photographs the
    skin itself (Matamalas et al., Scoliosis 2014, 9:23); a mean over a stretch of it needs no joint to be found
    and is not moved by one fold of skin. Distances are taken from T1, so that a trunk which stands aside as a
    whole has level shoulders still.

    Args:
        skin: the skin [mm]; arms may be cut off, but nothing above T1.
        spine: vertebrae, T1 among them [mm].
        across: unit vector of the pelvis' axis to the patient's left, shape (2,).

    Returns:
        None without T1, or where the skin beside it has no outline.
    """
    outline = upper_outline(skin, spine, across)
    if outline is None:
        return None
    left, right = (float(heights.mean()) for heights in outline.heights)
    return Shoulders(left, right, outline.reach * INNER, outline.reach * OUTER)


def upper_outline(skin: Surface, spine: Spine, across: np.ndarray) -> UpperOutline | None:
    """The outline that `shoulder_heights` takes heights of, with the same arguments; None where it is missing."""
    if "T1" not in spine.levels:
        return None
    centre = spine.centroids[spine.levels.index("T1")]
    aside = (skin.vertices[:, :2] - centre[:2]) @ across
    above = skin.vertices[:, 2] - centre[2]
    faces = skin.faces[(above[skin.faces] > -DEEP).all(axis=1)]
    if not len(faces):
        return None
    corners = faces.ravel()
    left, right = corners[np.argmax(aside[corners])], corners[np.argmin(aside[corners])]
    edge = int(left if aside[left] <= -aside[right] else right)
    reach = min(aside[left], -aside[right])
    if reach <= 0.0:
        return None
    start, end = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).T
    a, b = aside[start], aside[end]
    heights, ends = [], []
    for place in np.outer([reach, -reach], np.linspace(INNER, OUTER, PLACES)).ravel():
        crossed = np.flatnonzero((a <= place) != (b <= place))
        if not len(crossed):
            return None
        low, high = above[start[crossed]], above[end[crossed]]
        aside_at_height = low + (place - a[crossed]) / (b[crossed] - a[crossed]) * (high - low)
        highest = int(np.argmax(aside_at_height))
        heights.append(aside_at_height[highest])
        ends.append((start[crossed[highest]], end[crossed[highest]]))
    return UpperOutline(edge, float(reach), np.reshape(heights, (2, PLACES)), np.reshape(ends, (2, PLACES, 2)))
