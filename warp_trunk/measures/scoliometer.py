"""The slope of a standing back, as a scoliometer shows it, and the slope in the forward bend that goes with it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from warp_trunk.case.anatomy import THORACIC
from warp_trunk.geometry.section import last_crossing
from warp_trunk.spine.spine import Spine

BESIDE = {"C": 45.0, "T": 45.0, "L": 35.0}
"""How far beside the spine a scoliometer lies on the back, thoracic and lumbar [mm]."""
BENT = {
    "T9": THORACIC[8:11],
    "T10": THORACIC[9:12],
    "T11": ("T11",),
    "T12": ("T12",),
    "L1": ("T12", "L1", "L2"),
    "L2": ("L2",),
}
"""The standing levels whose mean slope is that of each level in the forward bend."""
BENT_SD = 4.5
"""Standard deviation of the slope in the forward bend about it [degrees], see docs/measures.md."""


def spinous_place(section: np.ndarray, centre: np.ndarray, across: np.ndarray, turn: float) -> np.ndarray | None:
    """Where the sagittal plane of a vertebra meets the skin behind it, shape (2,) [mm]; None where it does not.

    Args:
        section: of the back at its height, segments (n, 2, 2) [mm].
        centre: of the vertebra, shape (2,) [mm].
        across: unit vector of the pelvis' axis to the patient's left, shape (2,).
        turn: of the vertebra against that axis, counterclockwise seen from above [rad].
    """
    behind = np.array([-across[1], across[0]])
    return last_crossing(section, centre, behind - math.tan(turn) * across)


def scoliometer_on(
    outline: np.ndarray, centre: np.ndarray, across: np.ndarray, turn: float, level: str
) -> np.ndarray | None:
    """Where a scoliometer lies on the outline (n, 2) of a trunk, see `beside`; other arguments as for
    `spinous_place`, with the name of the vertebra."""
    section = np.stack([outline, np.roll(outline, -1, axis=0)], axis=1)
    place = spinous_place(section, centre, across, turn)
    return None if place is None else beside(section, place, across, level)


def beside(section: np.ndarray, place: np.ndarray, across: np.ndarray, level: str) -> np.ndarray | None:
    """The skin `BESIDE` a spinous process, left and right, and the place itself, shape (3, 2) [mm]; None where the
    skin ends before.

    Args:
        section: of the back, segments (n, 2, 2) [mm].
        place: of the spinous process on the skin, shape (2,) [mm].
        across: unit vector of the pelvis' axis to the patient's left, shape (2,).
        level: the name of the vertebra.
    """
    behind = np.array([-across[1], across[0]])
    ends = [last_crossing(section, place + side * BESIDE[level[0]] * across, behind) for side in (1.0, -1.0)]
    return None if any(end is None for end in ends) else np.array([*ends, place])


def slope_between(ends: np.ndarray, across: np.ndarray) -> float:
    """Slope of the line between points on the left and right, the first two of (n, 2) [degrees]; positive where
    the right one stands further back."""
    way = ends[1] - ends[0]
    return math.degrees(math.atan2(way @ np.array([-across[1], across[0]]), -(way @ across)))


def slopes_of(
    outlines: Mapping[str, np.ndarray | None], spine: Spine, across: np.ndarray
) -> dict[str, float | None]:
    """The slope of the standing back by level [degrees] (`slope_between`), beside the spinous process of each
    vertebra, which its pedicles show (`spinous_place`).

    Args:
        outlines: sections of the trunk (`outlines_of`) [mm].
        spine: vertebrae [mm].
        across: unit vector of the pelvis' axis to the patient's left, shape (2,).

    Returns:
        Top to bottom; None where it is missing.
    """
    slopes: dict[str, float | None] = {}
    turns = pedicle_turns(spine, across)
    for level, centre, turn in zip(spine.levels, spine.centroids, turns, strict=True):
        outline = outlines.get(level)
        ends = None if outline is None else scoliometer_on(outline, centre[:2], across, turn, level)
        slopes[level] = None if ends is None else slope_between(ends, across)
    return slopes


def pedicle_turns(spine: Spine, across: np.ndarray) -> np.ndarray:
    """The turn of each vertebra against the pelvis' axis, counterclockwise seen from above [rad], shape (levels,);
    0 where a pedicle is missing."""
    between = spine.pedicles[:, 0, :2] - spine.pedicles[:, 1, :2]
    behind = np.array([-across[1], across[0]])
    return np.nan_to_num(np.arctan2(between @ behind, between @ across))


def forward_bend(standing: Mapping[str, float | None]) -> dict[str, float | None]:
    """The mean reading of a scoliometer in the forward bend [degrees], by level from T9 to L2.

    In the mean of 20 patients (PCdare) it is the slope of the standing back, at T9 and T10 that of the level and
    the two below, at L1 that of the level and both its neighbours. One patient is off by a standard deviation of
    `BENT_SD`. Above T9 and below L2 the standing back says too little.

    Args:
        standing: the slope of the standing back by level [degrees].

    Returns:
        None where a standing level is missing.
    """
    readings: dict[str, float | None] = {}
    for level, levels in BENT.items():
        slopes = [value for near_level in levels if (value := standing.get(near_level)) is not None]
        readings[level] = sum(slopes) / len(slopes) if len(slopes) == len(levels) else None
    return readings
