"""A vertebra's motion against the pelvis, split into turn, tilt, flexion and sideways way."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from warp_trunk.measures.cobb import CobbAngle, cobb_angles, curves_after
from warp_trunk.measures.spine import ENDPLATES, asis_axis, spine_of

from .steps import Steps

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform, Rotation

    from warp_trunk.case.landmarks import Landmarks


class Vertebra(NamedTuple):
    """A vertebra that leads its ribs."""

    motion: RigidTransform
    """Its motion, the pelvis at rest [mm]."""
    axis: np.ndarray
    """Its centre, and its own axis upward, of any length, before, shape (2, 3) [mm]."""
    coupled: float | None = None
    """The turn that comes with the change of its curve [rad]; all of the turn when left out."""


@dataclass(frozen=True)
class VertebraParts:
    """How a vertebra moves, the pelvis at rest; its attitude is first a turn about its own axis, then flexion
    about the left-right axis, then a tilt in the coronal plane."""

    motion: RigidTransform
    """The whole motion [mm]."""
    shift: float
    """Way of the vertebra's centre to the patient's left [mm]."""
    turn: float
    """About the vertebra's own axis, counterclockwise seen from above [rad]."""
    tilt: float
    """Change of the lean of its axis to the left [rad]."""
    flexion: float
    """Change of the lean of its axis to the front [rad]."""
    leaning: tuple[float, float]
    """Tilt and flexion before [rad]."""
    middle: np.ndarray
    """The vertebra's centre before [mm], shape (3,)."""
    direct: float = 0.0
    """The part of the turn that does not come with the change of the curve but is forced by screws [rad]."""

    def share(self, *, turn: float, tilt: float) -> Rotation:
        """The rotation with a part of the tilt, all of the flexion and this turn [rad].

        What takes a part of the tilt leans by that part alone, before as after: it turns about its own axis, not
        about the vertebra's, so that a correction turns back what the curve has turned.
        """
        before = _attitude(tilt * self.leaning[0], self.leaning[1])
        after = _attitude(tilt * (self.leaning[0] + self.tilt), self.leaning[1] + self.flexion)
        from scipy.spatial.transform import Rotation  # heavy

        return after * Rotation.from_rotvec([0.0, 0.0, turn]) * before.inv()

    def without(self, turn: float, point: np.ndarray) -> np.ndarray:
        """Place of a point (3,) after the motion without a turn about the vertebra's own axis [rad, mm]."""
        from scipy.spatial.transform import Rotation  # heavy

        axis = _attitude(*self.leaning).apply([0.0, 0.0, 1.0])
        back = Rotation.from_rotvec(-turn * axis)
        return self.motion.apply(self.middle + back.apply(point - self.middle))


def split(motion: RigidTransform, axis: np.ndarray, coupled: float | None = None) -> VertebraParts:
    """The parts of a vertebra's motion.

    With z the axis in the vertebra's own frame, its attitude is A = Ry(tilt) Rx(flexion) Rz(turn). Tilt and
    flexion follow from where the axis points before and after; what is left of the rotation, A1^-1 R A0, turns
    about z.

    Args:
        motion: of the vertebra, the pelvis at rest [mm].
        axis: its centre, and its own axis upward, of any length, before, shape (2, 3) [mm].
        coupled: the turn that comes with the change of its curve (`coupled_turn.coupled_turns`) [rad]; all of the
            turn when left out.
    """
    centre, upward = axis
    before, after = _leaning(upward), _leaning(motion.rotation.apply(upward))
    turn = (_attitude(*after).inv() * motion.rotation * _attitude(*before)).as_rotvec()[2]
    return VertebraParts(
        motion=motion,
        shift=float(motion.apply(centre)[0] - centre[0]),
        turn=float(turn),
        tilt=after[0] - before[0],
        flexion=after[1] - before[1],
        leaning=before,
        middle=centre,
        direct=0.0 if coupled is None else float(turn) - coupled,
    )


def axial_turn(axis: np.ndarray, to_left: np.ndarray, across: np.ndarray) -> float:
    """How far a vertebra is turned about its own axis against the pelvis, counterclockwise seen from above [rad].

    Args:
        axis: its own axis, upward, shape (3,), of any length.
        to_left: from its right pedicle to its left one, shape (3,), of any length.
        across: from the right of the pelvis to its left, shape (2,), of any length.
    """
    x, y, _ = _attitude(*_leaning(axis)).inv().apply(to_left)
    turn = math.atan2(y, x) - math.atan2(across[1], across[0])
    return math.remainder(turn, 2.0 * math.pi)


def _leaning(axis: np.ndarray) -> tuple[float, float]:
    """Tilt to the left and flexion to the front of an axis [rad]."""
    x, y, z = axis
    return math.atan2(x, z), math.atan2(-y, math.hypot(x, z))


def _attitude(tilt: float, flexion: float) -> Rotation:
    from scipy.spatial.transform import Rotation  # heavy

    return Rotation.from_euler("YX", [tilt, flexion])


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
        Turn against the pelvis, counterclockwise seen from above [rad], by level. Empty if it is not determined:
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
