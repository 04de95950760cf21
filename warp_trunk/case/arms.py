"""Arms in the sections of a skin, beside the trunk or touching it."""

from __future__ import annotations

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.section import SHOULDERS, enclosed_area, own_part, sections, trunk_loop
from warp_trunk.geometry.surface import Surface

from .landmarks import Landmarks

_LEAST = 500.0
"""A smaller part of a section is no arm [mm2]."""


def arm_warnings(skin: Surface, landmarks: Landmarks, where: str) -> list[str]:
    """A warning with the levels at which a section of the skin has parts beside the trunk, or arms touch it.

    Args:
        skin: closed [mm].
        landmarks: of the spine [mm].
        where: what to call the skin.
    """
    levels = landmarks.vertebrae()
    middles = np.array([landmarks.of_bone(level).points.mean(axis=0) for level in levels]).reshape(-1, 3)
    try:
        cuts = sections(skin, middles[:, 2].tolist())
    except InputError:  # an open skin, which other checks name
        return []
    beside, touching = [], []
    for level, middle, loops in zip(levels, middles, cuts, strict=True):
        trunk = trunk_loop(loops, middle[:2])
        if sum(enclosed_area(loop) > _LEAST for loop in loops) > 1:
            beside.append(level)
        if trunk is not None and level not in SHOULDERS and own_part(trunk, middle[:2]) is not None:
            touching.append(level)
    if not beside and not touching:
        return []
    found = {"lie beside the trunk at": beside, "touch it at": touching}
    text = " and ".join(f"{what} {', '.join(at)}" for what, at in found.items() if at)
    return [
        f"{where}: arms {text}; measures take the trunk's own part there; cut "
        "the arms off with warp-trunk close --cut, as skin that touches is no flank."
    ]
