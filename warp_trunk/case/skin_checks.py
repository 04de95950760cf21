"""Checks of a skin: arms in its sections, and whether a second one is of the patient, in her frame."""

from __future__ import annotations

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.section import SHOULDERS, enclosed_area, own_part, sections, trunk_loop
from warp_trunk.geometry.surface import Surface, area_vectors

from .anatomy import rib_of
from .case import Case
from .landmarks import Landmarks

_LEAST_ARM = 500.0
"""A smaller part of a section is no arm [mm2]."""


def arm_warnings(skin: Surface, landmarks: Landmarks, where: str) -> list[str]:
    """A warning with the levels at which a section of the skin has parts beside the trunk, or arms touch it.

    Args:
        skin: closed [mm].
        landmarks: of the spine [mm].
        where: what to call the skin.
    """
    levels, middles = landmarks.vertebrae(), landmarks.middles()
    try:
        cuts = sections(skin, middles[:, 2].tolist())
    except InputError:  # an open skin, which other checks name
        return []
    beside, touching = [], []
    for level, middle, loops in zip(levels, middles, cuts, strict=True):
        trunk = trunk_loop(loops, middle[:2])
        if sum(enclosed_area(loop) > _LEAST_ARM for loop in loops) > 1:
            beside.append(level)
        if trunk is not None and level not in SHOULDERS and own_part(trunk, middle[:2]) is not None:
            touching.append(level)
    if not beside and not touching:
        return []
    levels_of = {"lie beside the trunk at": beside, "touch it at": touching}
    text = " and ".join(f"{what} {', '.join(at)}" for what, at in levels_of.items() if at)
    return [
        f"{where}: arms {text}; measures take the trunk's own part there; cut "
        "the arms off with warp-trunk close --cut, as skin that touches is no flank."
    ]


MOST_LEFT_OUT = 0.02
"""Share of the bones' vertices that may lie more than `OUTSIDE` outside a second skin: where they were before
surgery, or where the plan puts them."""
OUTSIDE = 15.0  # [mm]
FAR = 25.0
"""A second skin is usually nearer to the first in the mean [mm]; 11 mm between a curve of 55 degrees and none."""
_TURNED = 0.75
"""A skin that fits the first better by this factor once it is turned is turned. Girl of 13, curve of 55 degrees
against none: 10.7 mm and turned 17.8 mm."""
_CLOSE = 8.0
"""Skins that differ by less in the mean, apart from a shift, are not turned [mm]."""
_POINTS = 3000
"""Number of vertices that are compared."""
_HALF_TURN = (-1.0, -1.0, 1.0)


def check_second_skin(case: Case, second: Surface, where: str) -> list[str]:
    """Warnings of a second skin of a patient, before or after surgery.

    Args:
        case: the patient with her first skin and landmarks of the spine.
        second: the skin that is compared [mm].
        where: what to call it.

    Raises:
        InputError: it is turned by half a turn, as a file in RAS that is read as LPS is, or leaves bones outside.
    """
    first = case.skin
    distance = SurfaceDistance(second)
    low = max(skin.vertices[:, 2].min() for skin in (first, second))
    high = min(skin.vertices[:, 2].max() for skin in (first, second))
    points = first.vertices[(first.vertices[:, 2] >= low) & (first.vertices[:, 2] <= high)]
    if len(points) < 3:
        raise InputError(f"{where}: lies above or below the skin before surgery; bring it into its frame")
    points = points[:: -(-len(points) // _POINTS)]
    own, other = _middle(first, low, high), _middle(second, low, high)
    as_it_is = float(np.abs(distance.at(points - own + other)).mean())
    turned = float(np.abs(distance.at((points - own) * _HALF_TURN + other)).mean())
    if as_it_is > _CLOSE and turned < _TURNED * as_it_is:
        raise InputError(
            f"{where}: fits the skin before surgery better after half a turn about the vertical axis "
            f"({turned:.1f} mm in the mean, as it is {as_it_is:.1f}); it seems to be in RAS: write SPACE=RAS into "
            "its header, or negate x and y"
        )
    outside = [distance.at(points) for points in _bones(case)]
    share, out = min((float((off > OUTSIDE).mean()), float(off.max())) for off in outside)
    if share > MOST_LEFT_OUT:
        raise InputError(
            f"{where}: does not hold the bones: {100.0 * share:.0f} % of them lie more than {OUTSIDE:g} mm "
            f"outside, up to {out:.0f} mm; give the skin of this patient, registered to her bones"
        )
    apart = float(np.abs(distance.at(points)).mean())
    if apart > FAR:
        return [
            f"{where}: lies {apart:.0f} mm from the skin before surgery in the mean; register it to the bones."
        ]
    return []


def _bones(case: Case) -> list[np.ndarray]:
    """Points of the bones, or of landmarks where there are none, before surgery and where a plan puts them:
    vertebrae and their ribs with the landmarks, other bones as they were."""
    before, after = case.landmarks_before, case.landmarks_after
    points = {name: bone.vertices[:: -(-len(bone.vertices) // _POINTS)] for name, bone in case.bones.items()}
    points = points or {name: point[None] for name, point in zip(before.names, before.points, strict=True)}
    points_of = [np.concatenate(list(points.values()))]
    if after is not None:
        way = dict(zip(before.vertebrae(), after.middles() - before.middles(), strict=True))
        level_of = {name: rib.vertebra if (rib := rib_of(name)) else name.partition("_")[0] for name in points}
        points_of.append(np.concatenate([every + way.get(level_of[name], 0.0) for name, every in points.items()]))
    return points_of


def _middle(skin: Surface, low: float, high: float) -> np.ndarray:
    """The centre of a skin's area between two heights, x, y and 0."""
    centres = skin.vertices[skin.faces].mean(axis=1)
    areas = np.linalg.norm(area_vectors(skin.vertices, skin.faces), axis=1)
    areas = areas * ((centres[:, 2] >= low) & (centres[:, 2] <= high))
    return np.append(np.average(centres[:, :2], axis=0, weights=areas), 0.0)
