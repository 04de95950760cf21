"""How far each vertebra is turned, and the apical vertebra of each curve."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from warp_trunk.case.anatomy import THORACIC
from warp_trunk.geometry.section import turn

from .cobb import CobbAngle
from .spine import SacralLine, Spine, top_of_spine

TURNED = 5.0
"""An apex turned by less than this has no neutral vertebra beside it [degrees]: films cannot distinguish it
from none."""


@dataclass(frozen=True)
class ApicalVertebra:
    """The vertebra that stands furthest aside in a curve."""

    level: str
    """Its name."""
    rotation: float | None
    """Its axial rotation against the pelvis [degrees], see `axial_rotation`; None where a pedicle is missing."""
    translation: float | None
    """Distance of its centroid from the line [mm], positive to the right; None where that line is missing."""
    line: str
    """The landmark of the line: C7 or T1 for a thoracic apex, what `SacralLine` names for any other."""
    neutral_above: str | None
    """Upper neutral vertebra; None where rotations are missing or the apex is turned by less than `TURNED`."""
    neutral_below: str | None
    """Lower neutral vertebra; None likewise."""


def apical_vertebrae(
    spine: Spine, curves: Sequence[CobbAngle], rotation: Mapping[str, float | None], line: SacralLine
) -> tuple[ApicalVertebra, ...]:
    """The apical vertebra of every curve.

    Its translation is that of the Radiographic Measurement Manual (O'Brien, Kuklo, Blanke and Lenke 2008): of a
    thoracic apex, T2 to T11, from the plumb line of C7 (T1 where C7 has no landmarks); of a thoracolumbar or
    lumbar one from the central sacral vertical line; along the pelvis' axis.

    A neutral vertebra is the one on either side of the apex that is not turned: nearest to where the rotation
    passes through zero, before the apex of the next curve; the one turned least where it does not pass.

    Args:
        spine: vertebrae [mm].
        curves: as `cobb_angles` gives them, top to bottom.
        rotation: axial rotation by level [degrees], as `axial_rotation` gives it.
        line: see `sacral_line`.
    """
    apical = []
    apices = [-1, *(spine.levels.index(curve.apex) for curve in curves), len(spine.levels)]
    for (above, apex), below in zip(pairwise(apices), apices[2:], strict=False):
        level = spine.levels[apex]
        point, through = line.point, line.landmark
        if level in THORACIC[1:11]:
            top = top_of_spine(spine)
            point, through = (None, "T1") if top is None else (spine.centroids[spine.levels.index(top), :2], top)
        to_left = None if point is None else float((spine.centroids[apex, :2] - point) @ line.across)
        apical.append(
            ApicalVertebra(
                level=level,
                rotation=rotation[level],
                translation=None if to_left is None else -to_left,
                line=through,
                neutral_above=_neutral(spine.levels[above + 1 : apex + 1][::-1], rotation),
                neutral_below=_neutral(spine.levels[apex:below], rotation),
            )
        )
    return tuple(apical)


def _neutral(outward: Sequence[str], rotation: Mapping[str, float | None]) -> str | None:
    """The neutral vertebra among levels in order, from the apex outwards."""
    apex = rotation[outward[0]]
    turned_levels = {level: turned for level in outward[1:] if (turned := rotation[level]) is not None}
    if apex is None or abs(apex) < TURNED or not turned_levels:
        return None
    crossing = (pair for pair in pairwise(turned_levels) if turned_levels[pair[0]] * turned_levels[pair[1]] <= 0.0)
    return min(next(crossing, turned_levels), key=lambda level: abs(turned_levels[level]))


def axial_rotation(spine: Spine, across: np.ndarray) -> dict[str, float | None]:
    """Angle between the line through a vertebra's pedicles and the axis through the iliac spines, seen from above.

    The rotation about the vertical, in the axial plane of the patient (Stokes, Bigalow and Moreland 1986, from
    the pedicles; reviewed by Lam et al., Scoliosis 2008, 3:16); a pedicle is the mean of its upper and lower
    landmark. Positive as back surface rotation is: the vertebra's right side stands further back, as it does in
    a thoracic curve that is convex to the right.

    Args:
        spine: vertebrae with their pedicles [mm].
        across: unit vector of the pelvis' axis to the patient's left, shape (2,).

    Returns:
        Degrees by level, top to bottom; None where a pedicle has no landmark.
    """
    to_left = spine.pedicles[:, 0, :2] - spine.pedicles[:, 1, :2]
    return {
        level: -math.degrees(turn(across, line)) if np.isfinite(line).all() else None
        for level, line in zip(spine.levels, to_left, strict=True)
    }
