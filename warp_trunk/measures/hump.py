"""Height of the rib hump or lumbar hump."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .back_rotation import SPAN, DualTangent


@dataclass(frozen=True)
class Place:
    """A place on the back, between two points of the outline."""

    points: tuple[int, int]
    """Which, numbered as in the outline; the way backward is that of the two ..."""
    beside: tuple[int, int]
    """... the way aside that of these two: others only where the outline folds back on itself."""
    share: float
    """Part of the way from the first to the second."""


@dataclass(frozen=True)
class HumpTop:
    """Where the hump is highest over the other side of the back."""

    height: float
    """As `hump_height` [mm]."""
    right: Place
    """On the right of the spine."""
    left: Place
    """As far from it on the left."""
    corner: int | None
    """The point of the outline whose distance from the spine that is; None at `SPAN`/2."""


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
    return None if top is None else top.height


def hump_top(tangent: DualTangent) -> HumpTop | None:
    """The top of the hump of `hump_height`; None where the back is narrower than `SPAN`."""
    points = tangent.outline - tangent.spine
    aside = points @ tangent.across
    back = points @ np.array([-tangent.across[1], tangent.across[0]])
    first, last = int(np.argmax(back + aside)), int(np.argmax(back - aside))
    reach = min(aside[first], -aside[last])
    if reach < SPAN / 2.0:
        return None
    along = np.arange(first, last + 1 if last >= first else last + 1 + len(points)) % len(points)
    to_right = np.maximum.accumulate(-aside[along])  # where the outline folds back on itself, its outer part
    backward = back[along]
    corners = np.abs(to_right)
    further = np.flatnonzero((corners > SPAN / 2.0) & (corners < reach))
    distances = np.append(corners[further], [SPAN / 2.0, reach])
    right, left = np.interp(distances, to_right, backward), np.interp(-distances, to_right, backward)
    top = int(np.argmax(np.maximum(right, left)))
    outer = np.maximum.accumulate(np.where(-aside[along] >= to_right, np.arange(len(along)), 0))
    places = [_place(to_right, along, along[outer], side * distances[top]) for side in (1.0, -1.0)]
    narrower = first if aside[first] <= -aside[last] else last
    corner = [*along[outer[further]].tolist(), None, narrower][top]
    return HumpTop(float(right[top] - left[top]), places[0], places[1], corner)


def _place(to_right: np.ndarray, along: np.ndarray, outer: np.ndarray, x: float) -> Place:
    """Between which points of the outline `to_right`, which never falls, passes x."""
    i = int(np.clip(np.searchsorted(to_right, x, side="right") - 1, 0, len(along) - 2))
    way = to_right[i + 1] - to_right[i]
    share = float(np.clip((x - to_right[i]) / way, 0.0, 1.0)) if way > 0.0 else 0.0
    return Place((int(along[i]), int(along[i + 1])), (int(outer[i]), int(outer[i + 1])), share)
