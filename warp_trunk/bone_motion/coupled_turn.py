"""The part of a vertebra's turn that goes with the change of its curve; the rest is derotation by screws."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.measures.cobb import cobb_angles, curves_after
from warp_trunk.measures.spine import asis_axis, spine_of

from .vertebra_motion import axial_turn

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks


def coupled_turns(before: Landmarks, after: Landmarks) -> dict[str, float]:
    """How far each vertebra turns about its own axis because its curve changes.

    A vertebra of a curve is turned in proportion to it. Where surgery takes away a part of the Cobb angle, the
    same part of the turn goes with it: at the apex of each curve, and between two apices what lies between.
    Published humps follow this part: 5.6 degrees more of derotation at the same Cobb angle changed them by 0.4
    degrees (Tang et al. 2015).

    Args:
        before: landmarks before surgery.
        after: the same after.

    Returns:
        Turn against the pelvis, counterclockwise seen from above [rad], by level. Empty where it cannot be told:
        no curve of 10 degrees, or no iliac spines; a level without pedicles or endplates is left out.
    """
    curves = cobb_angles(before)
    corrected = {
        curve.apex: np.clip(1.0 - angle / curve.angle, -1.0, 1.0)
        for curve, angle in zip(curves, curves_after(curves, after), strict=True)
        if angle is not None
    }
    if not corrected or not {"asis_left", "asis_right"} <= set(before.names):
        return {}
    spine, across = spine_of(before), asis_axis(before)
    apices = [spine.levels.index(apex) for apex in corrected]
    part = np.interp(range(len(spine.levels)), apices, list(corrected.values()))
    axes = spine.endplates[:, 0] - spine.endplates[:, 1]
    to_left = spine.pedicles[:, 0] - spine.pedicles[:, 1]
    turns = {
        level: -float(part[row]) * axial_turn(axes[row], to_left[row], across)
        for row, level in enumerate(spine.levels)
    }
    return {level: turn for level, turn in turns.items() if np.isfinite(turn)}
