"""Back surface rotation of the upper back, in sections that follow the shoulders."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.geometry.section import section, trunk_loop

from .back_rotation import tangent_of
from .shoulders import shoulder_heights
from .spine import asis_axis, spine_of

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.geometry.surface import Surface

UPPER = ("T1", "T2")
"""Levels at which a horizontal section crosses the shoulders."""


def rotation_along_shoulders(skin: Surface, landmarks: Landmarks) -> dict[str, float | None]:
    """Back surface rotation at T1 and T2 [degrees], of sections that slope as the shoulders do.

    Where shoulders slope, a horizontal section cuts one of them higher than the other. The back leans forward
    there, so that it seems turned though nothing has turned: a back inclined by p and leaning by b, by
    atan(tan p sin b). The papers leave these levels out ([1] measures from T3 on, [2] from T4 on).

    Args:
        skin: the skin [mm], closed.
        landmarks: those of the spine and the pelvis that go with it [mm].

    Returns:
        By level, positive where the right side stands further back; None where the level or a shoulder is missing
        or no line touches both sides of the back.

    Raises:
        InputError: as `back_surface_rotation`.
    """
    shoulders = shoulder_heights(skin, spine_of(landmarks), asis_axis(landmarks))
    return {
        level: None if shoulders is None else leaning_rotation(skin, landmarks, level, shoulders.slope)
        for level in UPPER
    }


def leaning_rotation(skin: Surface, landmarks: Landmarks, level: str, lean: float) -> float | None:
    """Back surface rotation of the section at a level that rises to the right by `lean` [degrees].

    The other arguments, the sign and what is raised are those of `rotation_along_shoulders`.
    """
    spine, across = spine_of(landmarks), asis_axis(landmarks)
    if level not in spine.levels:
        return None
    centre = spine.centroids[spine.levels.index(level)]
    c, s = math.cos(math.radians(lean)), math.sin(math.radians(lean))
    left, up = np.array([*across, 0.0]), np.array([0.0, 0.0, 1.0])
    from_centre = skin.vertices - centre
    aside, above = from_centre @ left, from_centre @ up
    upright = np.outer((c - 1.0) * aside - s * above, left) + np.outer(s * aside + (c - 1.0) * above, up)
    outline = trunk_loop(section(replace(skin, vertices=skin.vertices + upright), float(centre[2])), centre[:2])
    found = None if outline is None else tangent_of(outline, centre, across)
    return None if found is None else found.angle
