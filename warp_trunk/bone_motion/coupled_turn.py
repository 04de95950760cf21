"""The part of a vertebra's turn that goes with the change of its curve; the rest is derotation by screws."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.measures.cobb import CobbAngle, cobb_angles, curves_after
from warp_trunk.measures.spine import ENDPLATES, asis_axis, spine_of

from .steps import Steps
from .vertebra_motion import axial_turn

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks

_PELVIS = ("asis_left", "asis_right")


def coupled_turns(before: Landmarks, after: Landmarks, *, steps: Steps | None = None) -> dict[str, float]:
    """How far each vertebra turns about its own axis because its curve changes.

    A vertebra of a curve is turned in proportion to it. Where surgery takes away a part of the Cobb angle, the
    same part of the turn goes with it: at the apex of each curve, and between two apices what lies between.
    Published humps follow this part: 5.6 degrees more of derotation at the same Cobb angle changed them by 0.4
    degrees (Tang et al. 2015).

    Args:
        before: landmarks before surgery.
        after: the same after.
        steps: how steps are taken; just so when left out.

    Returns:
        Turn against the pelvis, counterclockwise seen from above [rad], by level. Empty where it cannot be told:
        no curve of 10 degrees, or no iliac spines; a level without pedicles or endplates is left out.
    """
    steps = steps or Steps()
    parts: dict[str, float] = {}
    for curve in cobb_angles(before):
        ends = [f"{level}_{end}" for level in (curve.upper, curve.lower) for end in ENDPLATES]
        rows = _rows(before, ends)
        points = [steps.rows(one.points, rows) for one in (before, after)]
        parts[curve.apex] = steps(_corrected, curve, type(before)(tuple(ends), points[0]), *points)
    if not parts or not set(_PELVIS) <= set(before.names):
        return {}
    levels, turns = spine_of(before).levels, {}
    apices = [levels.index(apex) for apex in parts]
    for row, level in enumerate(levels):
        shares = [float(np.interp(row, apices, one)) for one in np.eye(len(apices))]
        own = tuple(name for name in before.names if name.startswith(f"{level}_") or name in _PELVIS)
        points = steps.rows(before.points, _rows(before, own))
        turn = steps(_coupled, type(before)(own, points), points, shares, *parts.values())
        if math.isfinite(turn):
            turns[level] = turn
    return turns


def _rows(landmarks: Landmarks, names: Sequence[str]) -> np.ndarray:
    return np.array([landmarks.index(name) for name in names])


def _corrected(curve: CobbAngle, marks: Landmarks, before: np.ndarray, after: np.ndarray) -> float:
    """The part of a curve's Cobb angle that surgery takes away, by the landmarks of its end vertebrae."""
    was, now = (curves_after((curve,), replace(marks, points=points))[0] for points in (before, after))
    return math.nan if was is None or now is None else float(np.clip(1.0 - now / abs(was), -1.0, 1.0))


def _coupled(marks: Landmarks, points: np.ndarray, shares: Sequence[float], *parts: float) -> float:
    """The coupled turn of a vertebra by its own landmarks and the iliac spines, and the parts of curves by what it
    has of each; NaN without pedicles or endplates."""
    there = replace(marks, points=points)
    spine = spine_of(there)
    (upper, lower), (left, right) = spine.endplates[0], spine.pedicles[0]
    return -float(np.dot(shares, parts)) * axial_turn(upper - lower, left - right, asis_axis(there))
