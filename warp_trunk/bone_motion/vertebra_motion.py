"""A vertebra's motion against the pelvis, split into turn, tilt, flexion and sideways way."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform, Rotation


@dataclass(frozen=True)
class VertebraMotion:
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
        """Where a point (3,) goes by the motion less a turn about the vertebra's own axis [rad, mm]."""
        from scipy.spatial.transform import Rotation  # heavy

        axis = _attitude(*self.leaning).apply([0.0, 0.0, 1.0])
        back = Rotation.from_rotvec(-turn * axis)
        return self.motion.apply(self.middle + back.apply(point - self.middle))


def split(
    motion: RigidTransform, centre: np.ndarray, axis: np.ndarray, coupled: float | None = None
) -> VertebraMotion:
    """The parts of a vertebra's motion.

    With z the axis in the vertebra's own frame, its attitude is A = Ry(tilt) Rx(flexion) Rz(turn). Tilt and
    flexion follow from where the axis points before and after; what is left of the rotation, A1^-1 R A0, turns
    about z.

    Args:
        motion: of the vertebra, the pelvis at rest [mm].
        centre: a point in its middle, before, shape (3,) [mm].
        axis: its own axis before, upward, shape (3,), of any length.
        coupled: the turn that comes with the change of its curve (`coupled_turn.coupled_turns`) [rad]; all of the
            turn when left out.
    """
    before, after = _leaning(axis), _leaning(motion.rotation.apply(axis))
    turn = (_attitude(*after).inv() * motion.rotation * _attitude(*before)).as_rotvec()[2]
    return VertebraMotion(
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
