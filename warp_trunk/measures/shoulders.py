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
    if "T1" not in spine.levels:
        return None
    centre = spine.centroids[spine.levels.index("T1")]
    aside = (skin.vertices[:, :2] - centre[:2]) @ across
    above = skin.vertices[:, 2] - centre[2]
    faces = skin.faces[(above[skin.faces] > -DEEP).all(axis=1)]
    if not len(faces):
        return None
    reach = aside[faces]
    edge = min(float(reach.max()), -float(reach.min()))
    if edge <= 0.0:
        return None
    places = edge * np.linspace(INNER, OUTER, PLACES)
    heights = [_outline(aside, above, faces, side * places) for side in (1.0, -1.0)]
    if not np.isfinite(heights).all():
        return None
    left, right = (float(height.mean()) for height in heights)
    return Shoulders(left, right, float(places[0]), float(places[-1]))


def _outline(aside: np.ndarray, above: np.ndarray, faces: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Height of the highest edge of `faces` at each place, shape (places,); -inf where none is crossed."""
    start, end = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).T
    a, b = aside[start], aside[end]
    heights = np.full(len(places), -np.inf)
    for number, place in enumerate(places):
        crossed = np.flatnonzero((a <= place) != (b <= place))
        if len(crossed):
            share = (place - a[crossed]) / (b[crossed] - a[crossed])
            low, high = above[start[crossed]], above[end[crossed]]
            heights[number] = float((low + share * (high - low)).max())
    return heights
