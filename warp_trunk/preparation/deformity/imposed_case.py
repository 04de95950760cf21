"""A case made from straight, healthy anatomy: a scoliosis and its correction, both known exactly."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from warp_trunk.case import Case
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface

from ..landmark_finder import find_landmarks
from .deformity import correct, impose
from .spine_curve import VERTEBRAE, Curve

STRAIGHT = 5.0
"""A spine with a larger Cobb angle is not straight [degrees]."""
_TURN = 1.4


def make_case(
    skin: Surface,
    bones: Mapping[str, Surface],
    curve: Curve,
    correction: float,
    name: str | None = None,
) -> Case:
    """Impose a curve on straight anatomy and plan the correction of a fraction of it.

    There is no trunk after surgery to compare with.

    >>> made = wt.make_case(skin, bones, wt.SpineCurve(kind="double_major", cobb=40.0), correction=0.7)
    >>> made.name
    'double_major 40 degrees, 70 % corrected'

    Args:
        skin: the straight trunk, closed, in patient axes (LPS) [mm].
        bones: T1 to L5, hip_left and hip_right, and as many others as there are, by name.
        curve: the deformity before surgery.
        correction: fraction of Cobb angle and axial rotation that surgery takes away, 0 to 1.
        name: what to call the case; made from the curve when left out.

    Raises:
        InputError: bones that are not straight (`check_straight`) or without landmarks to find (`find_landmarks`),
            a curve that folds the trunk (`impose`), or a fraction outside [0, 1].
    """
    check_straight(bones)
    straight = find_landmarks(bones).complete()
    after = correct(straight, curve, correction)
    deformed, moved, before = impose(skin, bones, straight, curve)
    return Case(
        name=name or f"{curve}, {100 * correction:g} % corrected",
        skin=deformed,
        bones=moved,
        landmarks_before=before,
        landmarks_after=after,
    )


def check_straight(bones: Mapping[str, Surface]) -> None:
    """Raise InputError where the vertebrae stand in a curve already, from the line through their middles.

    That line turns by 1 / `_TURN` of the Cobb angle, as curves of 4 to 60 degrees imposed on straight anatomy
    show, whose own line turns by 0.8 degrees.
    """
    levels = [level for level in VERTEBRAE if level in bones]
    if len(levels) < 3:
        return  # the search for landmarks reports what is missing
    middles = np.array(
        [0.5 * (bones[level].vertices.min(axis=0) + bones[level].vertices.max(axis=0)) for level in levels]
    )
    up = middles[:-2] - middles[2:]
    cobb = _TURN * float(np.ptp(np.degrees(np.arctan2(up[:, 0], up[:, 2]))))
    if cobb > STRAIGHT:
        raise InputError(
            f"bones: the spine must be straight, but has a curve of about {cobb:.0f} degrees, and {STRAIGHT:g} is "
            "the most; plan the correction of a real curve with warp-trunk plan"
        )
