"""Height difference of the shoulders, from the skin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from warp_trunk.geometry.surface import Surface

    from .spine import Spine

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
        there = low + (place - a[crossed]) / (b[crossed] - a[crossed]) * (high - low)
        highest = int(np.argmax(there))
        heights.append(there[highest])
        ends.append((start[crossed[highest]], end[crossed[highest]]))
    return UpperOutline(edge, float(reach), np.reshape(heights, (2, PLACES)), np.reshape(ends, (2, PLACES, 2)))
