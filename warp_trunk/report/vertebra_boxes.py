"""Vertebrae as boxes, so that a planned spine can be looked at."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.measures.spine import spine_of

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks

WIDE, DEEP = 1.6, 1.3
"""Width and depth of a vertebral body over its height: usual ones, because the landmarks give only the height."""


FACES = ((0, 1, 2, 3), (7, 6, 5, 4), (1, 0, 4, 5), (2, 1, 5, 6), (3, 2, 6, 7), (0, 3, 7, 4))
"""Corners of the faces of a box, counterclockwise from outside: top, bottom, left, back, right, front."""


@dataclass(frozen=True, eq=False)
class VertebraBox:
    """The body of a vertebra as a box."""

    level: str
    """Its name."""
    corners: np.ndarray
    """Its corners [mm], shape (8, 3): the upper four, then the lower four, each counterclockwise from above."""
    pedicles: np.ndarray
    """Left and right pedicle [mm], shape (2, 3)."""


def vertebra_boxes(landmarks: Landmarks) -> list[VertebraBox]:
    """The vertebrae that have all six landmarks, top to bottom.

    A box stands on the axis between the endplate centres, and its left side points to the left pedicle: so it
    leans and turns as the vertebra does.
    """
    spine = spine_of(landmarks)
    boxes = []
    for level, endplates, pedicles in zip(spine.levels, spine.endplates, spine.pedicles, strict=True):
        if not (np.isfinite(endplates).all() and np.isfinite(pedicles).all()):
            continue
        axis = endplates[0] - endplates[1]
        height = np.linalg.norm(axis)
        up = axis / height
        to_left = pedicles[0] - pedicles[1]
        to_left -= (to_left @ up) * up
        to_left /= np.linalg.norm(to_left)
        back = np.cross(up, to_left)
        around = [(1, -1), (1, 1), (-1, 1), (-1, -1)]  # left and front first
        rim = np.array([0.5 * height * (x * WIDE * to_left + y * DEEP * back) for x, y in around])
        boxes.append(VertebraBox(level, np.concatenate([endplates[0] + rim, endplates[1] + rim]), pedicles))
    return boxes
