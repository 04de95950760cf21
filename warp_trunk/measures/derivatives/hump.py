"""The derivative of the height of a hump."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..back_rotation import DualTangent
from ..hump import hump_top
from .derivative import Derivative, Level

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.geometry.surface import Surface


def hump_derivative(skin: Surface, landmarks: Landmarks, level: str, tangent: DualTangent) -> Derivative | None:
    """Height of the hump at a level [mm], and how it changes; None where there is none (`hump_height`).

    The top stays the same corner of the outline as it moves by a little; the other side is followed where it is as
    far from the spine. Arguments as for `rotation_derivative`.
    """
    top = hump_top(tangent)
    if top is None:
        return None
    found = Level(skin, landmarks, level)
    across = tangent.across
    backward = np.array([-across[1], across[0]])
    points = tangent.outline - tangent.spine
    aside, back = points @ across, points @ backward
    by_aside, by_back = np.zeros(len(points)), np.zeros(len(points))
    for place, side in ((top.right, 1.0), (top.left, -1.0)):
        parts = np.array([1.0 - place.share, place.share])
        first, second = place.beside
        way = aside[first] - aside[second]
        slope = 0.0 if way == 0.0 else (back[place.points[1]] - back[place.points[0]]) / way  # to the right
        np.add.at(by_back, list(place.points), side * parts)
        np.add.at(by_aside, [first, second], side * slope * parts)
        if top.corner is not None:  # both sides are followed at its distance |aside|
            by_aside[top.corner] += slope * np.sign(aside[top.corner])
    for point in np.flatnonzero((by_aside != 0.0) | (by_back != 0.0)):
        weight = by_aside[point] * across + by_back[point] * backward
        found.add_point(tangent.outline[point], weight)
        found.add_centroid(-np.array([*weight, 0.0]))
    found.add_turn(float(by_aside @ back - by_back @ aside))
    return found.derivative(top.height)
