"""A vertebra's motion against the pelvis, split into axial rotation, lateral bending, flexion and sideways way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from warp_trunk.case.landmarks import ASIS, VERTEBRA_POINTS, Landmarks
from warp_trunk.geometry.rigid import RigidMotion, rotated
from warp_trunk.spine.cobb import CobbAngle, vertebral_tilt
from warp_trunk.spine.endplate_smoothing import EndplateSmoothing
from warp_trunk.spine.spine import ENDPLATES


class Vertebrae(NamedTuple):
    """Vertebrae that lead their ribs, in one set of landmarks or many."""

    levels: tuple[str, ...]
    """Their names."""
    motion: RigidMotion
    """Their motions, the pelvis at rest [mm], shape (..., levels)."""
    axis: np.ndarray
    """Their centres, and their own axes upward, of any length, before, shape (..., levels, 2, 3) [mm]."""
    coupled: np.ndarray | float = np.nan
    """The rotation that comes with the change of their curves [rad], shape (..., levels); NaN: all of it."""

    def parts(self, levels: Sequence[str]) -> VertebraParts:
        """The parts of the motions of some of them, in this order."""
        rows = [self.levels.index(level) for level in levels]
        coupled = np.broadcast_to(self.coupled, self.motion.shape)[..., rows]
        motion = RigidMotion(self.motion.rotation[..., rows, :, :], self.motion.translation[..., rows, :])
        return split(motion, self.axis[..., rows, :, :], coupled)


@dataclass(frozen=True, eq=False)
class VertebraParts:
    """How vertebrae move, the pelvis at rest, shape (...); an attitude is first a turn about the vertebra's own
    axis, then flexion about the left-right axis, then bending in the coronal plane."""

    motion: RigidMotion
    """The whole motion [mm]."""
    shift: np.ndarray
    """Way of the vertebra's centre to the patient's left [mm]."""
    axial_rotation: np.ndarray
    """About the vertebra's own axis, counterclockwise seen from above [rad]."""
    lateral_bending: np.ndarray
    """Change of the lean of its axis to the left [rad]."""
    flexion: np.ndarray
    """Change of the lean of its axis to the front [rad]."""
    leaning: np.ndarray
    """Lean to the left and to the front before [rad], shape (..., 2)."""
    middle: np.ndarray
    """The vertebra's centre before [mm], shape (..., 3)."""
    derotation: np.ndarray
    """The part of the axial rotation that does not come with the change of the curve but is forced by screws
    [rad]."""

    def share(self, *, axial_rotation: np.ndarray, lateral_bending: np.ndarray | float) -> np.ndarray:
        """The rotations (..., 3, 3) with a part of the bending, all of the flexion and this axial rotation [rad].

        What takes a part of the bending leans by that part alone, before as after: it turns about its own axis,
        not about the vertebra's, so that a correction turns back what the curve has turned.
        """
        left, front = self.leaning[..., 0], self.leaning[..., 1]
        before = attitudes(lateral_bending * left, front)
        attitude = lateral_bending * (left + self.lateral_bending), front + self.flexion
        return attitudes(*attitude, axial_rotation) @ np.swapaxes(before, -1, -2)

    def without(self, turn: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Places of points (..., 3) after the motions without a turn about the vertebra's own axis [rad, mm]."""
        lean = self.leaning[..., 0], self.leaning[..., 1]
        back = attitudes(*lean, -turn) @ np.swapaxes(attitudes(*lean), -1, -2)
        return self.motion.apply(self.middle + rotated(back, points - self.middle))


def split(motion: RigidMotion, axis: np.ndarray, coupled: np.ndarray | float = np.nan) -> VertebraParts:
    """The parts of the motions of vertebrae.

    With z the axis in the vertebra's own frame, its attitude is A = Ry(bending) Rx(flexion) Rz(turn). Bending and
    flexion follow from where the axis points before and after; what is left of the rotation, A1^-1 R A0, turns
    about z.

    Args:
        motion: of the vertebrae, the pelvis at rest [mm], shape (...).
        axis: their centres, and their own axes upward, of any length, before, shape (..., 2, 3) [mm].
        coupled: the rotation that comes with the change of their curves (`CoupledTurns`) [rad], shape (...); all
            of it where NaN.
    """
    centre, upward = axis[..., 0, :], axis[..., 1, :]
    before, after = _leaning(upward), _leaning(rotated(motion.rotation, upward))
    end, start = attitudes(after[..., 0], after[..., 1]), attitudes(before[..., 0], before[..., 1])
    left = np.swapaxes(end, -1, -2) @ motion.rotation @ start
    turn = np.arctan2(left[..., 1, 0], left[..., 0, 0])
    change = after - before
    return VertebraParts(
        motion=motion,
        shift=motion.apply(centre)[..., 0] - centre[..., 0],
        axial_rotation=turn,
        lateral_bending=change[..., 0],
        flexion=change[..., 1],
        leaning=before,
        middle=centre,
        derotation=np.where(np.isnan(coupled), 0.0, turn - coupled),
    )


def axial_turn(axis: np.ndarray, to_left: np.ndarray, across: np.ndarray) -> np.ndarray:
    """How far vertebrae are turned about their own axes against the pelvis, counterclockwise from above [rad].

    Args:
        axis: their own axes, upward, shape (..., 3), of any length.
        to_left: from the right pedicle of each to its left one, shape (..., 3), of any length.
        across: from the right of the pelvis to its left, shape (..., 2), of any length.
    """
    lean = _leaning(axis)
    own = rotated(np.swapaxes(attitudes(lean[..., 0], lean[..., 1]), -1, -2), to_left)
    turn = np.arctan2(own[..., 1], own[..., 0]) - np.arctan2(across[..., 1], across[..., 0])
    return turn - 2.0 * np.pi * np.round(turn / (2.0 * np.pi))


def _leaning(axis: np.ndarray) -> np.ndarray:
    """Lean to the left and to the front of axes (..., 3) [rad], shape (..., 2)."""
    x, y, z = axis[..., 0], axis[..., 1], axis[..., 2]
    return np.stack([np.arctan2(x, z), np.arctan2(-y, np.hypot(x, z))], axis=-1)


def attitudes(
    bending: np.ndarray | float, flexion: np.ndarray | float, turn: np.ndarray | float = 0.0
) -> np.ndarray:
    """Rotations Ry(bending) Rx(flexion) Rz(turn) by angles (...) [rad], shape (..., 3, 3)."""
    bending, flexion, turn = np.broadcast_arrays(bending, flexion, turn)
    ca, sa, cb, sb, ct, st = (f(x) for x in (bending, flexion, turn) for f in (np.cos, np.sin))
    rows = [
        [ca * ct + sa * sb * st, sa * sb * ct - ca * st, sa * cb],
        [cb * st, cb * ct, -sb],
        [ca * sb * st - sa * ct, sa * st + ca * sb * ct, ca * cb],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


class CoupledTurns:
    """How far each vertebra turns about its own axis because its curve changes.

    A vertebra of a curve is turned in proportion to it. Where surgery takes away a part of the Cobb angle, the
    same part of the turn goes with it: at the apex of each curve, and between two apices what lies between.
    Published humps follow this part: 5.6 degrees more of derotation at the same Cobb angle changed them by 0.4
    degrees (Tang et al. 2015).
    """

    def __init__(self, landmarks: Landmarks, levels: Sequence[str]) -> None:
        """For the landmarks before surgery, and the vertebrae that are asked for."""
        self._place = {name: row for row, name in enumerate(landmarks.names)}
        whole = [
            number
            for number, level in enumerate(levels)
            if all(f"{level}_{end}" in self._place for end in VERTEBRA_POINTS)
        ]
        self._whole, self._count, self._marked = whole, len(levels), landmarks.vertebrae()
        self._along = [self._marked.index(levels[number]) for number in whole]
        rows = [[self._place[f"{levels[number]}_{end}"] for end in VERTEBRA_POINTS] for number in whole]
        self._rows = np.array(rows, dtype=int).reshape(-1, 6)
        self._asis = [self._place[name] for name in ASIS if name in self._place]
        plates = [[self._place.get(f"{level}_{end}", -1) for end in ENDPLATES] for level in self._marked]
        self._plates = np.array(plates, dtype=int).reshape(-1, 2)

    def endplates(self, points: np.ndarray) -> np.ndarray:
        """Superior and inferior endplate centres of the vertebrae, top to bottom, shape (..., n, 2, 3) [mm].

        Args:
            points: landmarks, shape (..., landmarks, 3) [mm].

        Returns:
            NaN where one is missing.
        """
        return np.where((self._plates >= 0)[..., None], points[..., self._plates, :], np.nan)

    def of(
        self,
        curves: Sequence[CobbAngle],
        before: np.ndarray,
        after: np.ndarray,
        smoothing: Sequence[EndplateSmoothing | None] = (None, None),
    ) -> np.ndarray:
        """Turns of the vertebrae against the pelvis, counterclockwise seen from above [rad], shape (sets, levels).

        Args:
            curves: those before surgery (`cobb_angles`).
            before: sets of landmarks before, shape (sets, landmarks, 3) [mm].
            after: the same after.
            smoothing: of the endplates before and after (`endplate_smoothing`).

        Returns:
            NaN where they are not determined: no curve of 10 degrees, no iliac spines, a level without all
            pedicles and endplates.
        """
        turns = np.full((len(before), self._count), np.nan)
        if not curves or len(self._asis) < 2:
            return turns
        apices = [self._marked.index(curve.apex) for curve in curves]
        shares = np.stack([np.interp(self._along, apices, unit) for unit in np.eye(len(apices))])  # curves, levels
        corrected = self._corrected(curves, smoothing, before, after)
        marks = before[:, self._rows]
        axis = marks[..., 0, :] - marks[..., 1, :]
        to_left = 0.5 * (marks[..., 2, :] + marks[..., 3, :] - marks[..., 4, :] - marks[..., 5, :])
        across = before[:, self._asis[0], :2] - before[:, self._asis[1], :2]
        turns[:, self._whole] = -(corrected @ shares) * axial_turn(axis, to_left, across[:, None])
        return turns

    def _corrected(
        self,
        curves: Sequence[CobbAngle],
        smoothing: Sequence[EndplateSmoothing | None],
        before: np.ndarray,
        after: np.ndarray,
    ) -> np.ndarray:
        """The part of each curve's Cobb angle that surgery takes away, shape (sets, curves)."""
        ends = np.array([[self._marked.index(level) for level in (c.upper, c.lower)] for c in curves])
        tilts = []
        for smoother, points in zip(smoothing, (before, after), strict=True):
            plates = self.endplates(points)
            tilts.append(vertebral_tilt(plates if smoother is None else smoother.smoothed(plates))[:, ends])
        was, now = (tilt[..., 0] - tilt[..., 1] for tilt in tilts)
        side = np.array([1.0 if curve.convex == "right" else -1.0 for curve in curves])
        return np.clip(1.0 - side * now / np.abs(was), -1.0, 1.0)
