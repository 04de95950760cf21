"""A scoliotic curve of the spine, published or measured, as a rigid motion of each vertebra."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from msgspec import Meta

from warp_trunk.bone_motion.vertebra_motion import attitudes
from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.case.landmarks import Landmarks, read_landmarks
from warp_trunk.checking import check_fields
from warp_trunk.errors import InputError
from warp_trunk.geometry.rigid import RigidMotion
from warp_trunk.geometry.section import arc_length
from warp_trunk.geometry.surface import unit
from warp_trunk.spine.cobb import sagittal_angle
from warp_trunk.spine.spine import Spine, spine_of

from .patient_spine import spine_of_marks
from .published_curves import (
    CURVES,
    KYPHOSIS,
    LUMBOSACRAL,
    SECONDARY_ROTATION,
    Kind,
    published_tilts,
    secondary_share,
    thoracic_rotation,
)

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

LEVELS = len(VERTEBRAE)


@dataclass(frozen=True, eq=False)
class SpineAngles:
    """How the vertebrae T1 to L5 are turned from the straight spine, each shape (17,) [rad]."""

    tilt: np.ndarray
    """In the coronal plane, positive towards +x going up."""
    pitch: np.ndarray
    """In the sagittal plane, positive forward going up."""
    turn: np.ndarray
    """About the vertebra's own axis, positive from +x to +y."""
    top: float | None = None
    """Where the middle of T1 comes to lie beside its place in the straight spine, along +x [mm]; where the tilts
    take it when left out."""


@dataclass(frozen=True, kw_only=True)
class SpineCurve:
    """A scoliosis by the numbers a clinic gives, in the mean shape of patients with such a curve.

    The shapes and their sources stand in `published_curves`.

    >>> wt.SpineCurve(kind="thoracolumbar", cobb=45.0).direction
    'right'
    """

    kind: Kind = "thoracic"
    """Where the main curve is; end vertebrae T5 to T12, T10 to L4, or T5 to T11 with a lumbar curve to L4."""
    cobb: Annotated[float, Meta(ge=0.0, le=120.0, description="degrees")] = 60.0
    """Angle of the main curve in the coronal plane [deg], 0 to 120."""
    apical_rotation: Annotated[float, Meta(ge=0.0, le=60.0, description="degrees")] | None = None
    """Axial rotation of the apical vertebra, its body towards the convex side [deg], 0 to 60; when left out
    0.26 kyphosis + 0.34 Cobb - 5.4 (thoracic; Sullivan et al. 2017) or 0.32 of the Cobb angle (thoracolumbar)."""
    direction: Literal["right", "left"] = "right"
    """The patient's side to which the main curve is convex."""
    kyphosis: Annotated[float, Meta(ge=-20.0, le=80.0, description="degrees")] | None = None
    """Kyphosis from T5 to T12 [deg], -20 to 80; that of the straight spine when left out."""
    secondary_rotation: Annotated[float, Meta(ge=-30.0, le=60.0, description="degrees")] | None = None
    """Opposite rotation at the apex of the secondary curve [deg], -30 to 60; 0.25 of its Cobb angle when left
    out."""
    upper_share: Annotated[float, Meta(ge=0.0, le=1.0)] | None = None
    """Cobb angle of the curve above the main one over that of the main one, 0 to 1; that of the mean shape when
    left out."""
    lower_share: Annotated[float, Meta(ge=0.0, le=1.0)] | None = None
    """The same for the curve below it."""
    t1_offset: Annotated[float, Meta(ge=-100.0, le=100.0, description="mm")] | None = None
    """How far T1 stands to the convex side of its place above L5 [mm], -100 to 100; where the tilts take it when
    left out."""

    def __post_init__(self) -> None:
        check_fields(self, "curve")

    def __str__(self) -> str:
        return f"{self.kind} {self.cobb:g} degrees"

    @property
    def rotation(self) -> float:
        """Axial rotation of the apical vertebra, given or by default [deg]."""
        if self.apical_rotation is not None:
            return self.apical_rotation
        if (ratio := CURVES[self.kind].rotation_per_cobb) is not None:
            return ratio * self.cobb
        return thoracic_rotation(self.cobb, KYPHOSIS[0] if self.kyphosis is None else self.kyphosis)

    @property
    def secondary(self) -> float:
        """Opposite axial rotation at the apex of the secondary curve, given or by default [deg]."""
        if self.secondary_rotation is not None:
            return self.secondary_rotation
        return SECONDARY_ROTATION[0] * self.cobb * secondary_share(CURVES[self.kind], self._tilts())

    @property
    def shoulders(self) -> float:
        """How much higher the right shoulder stands than the left [mm]."""
        return (1.0 if self.direction == "right" else -1.0) * CURVES[self.kind].shoulder * self.cobb

    def corrected(self, fraction: float) -> SpineCurve:
        """The curve that is left when a fraction in [0, 1] of Cobb angle and rotation is taken away.

        The kyphosis stays, and T1 comes back above L5 by the same fraction.

        Raises:
            InputError: a fraction outside [0, 1].
        """
        left = left_after(fraction)
        return replace(
            self,
            cobb=left * self.cobb,
            apical_rotation=left * self.rotation,
            secondary_rotation=left * self.secondary,
            t1_offset=None if self.t1_offset is None else left * self.t1_offset,
        )

    def angles(self, straight: Spine) -> SpineAngles:
        """The turns of each vertebra from the straight spine."""
        from scipy.interpolate import PchipInterpolator

        side = -1.0 if self.direction == "right" else 1.0
        levels = np.arange(LEVELS)
        published = CURVES[self.kind]
        nodes = [VERTEBRAE.index(level) for level in published.levels]
        at_nodes = self.rotation * np.array(published.main) - self.secondary * np.array(published.opposite)
        turn = PchipInterpolator(nodes, at_nodes)(levels)
        pitch = np.zeros(LEVELS)
        if self.kyphosis is not None:
            own = sagittal_angle(straight, "T5", "T12")
            if own is None:
                raise InputError("landmarks: the kyphosis needs both endplates of T5 and T12; give them")
            pitch = (self.kyphosis - own) * PchipInterpolator([0, 4, 11, 16], [1.0, 1.0, 0.0, 0.0])(levels)
        return SpineAngles(
            tilt=side * np.radians(self.cobb * self._tilts()),
            pitch=np.radians(pitch),
            turn=side * np.radians(turn),
            top=None if self.t1_offset is None else side * self.t1_offset,
        )

    def _tilts(self) -> np.ndarray:
        return published_tilts(CURVES[self.kind], self.upper_share, self.lower_share)


def left_after(fraction: float) -> float:
    """The remaining fraction of a curve after a correction; InputError if that is not in [0, 1]."""
    if not 0.0 <= fraction <= 1.0:
        raise InputError(f"correction: the fraction must be between 0 and 1, not {fraction}")
    return 1.0 - fraction


@dataclass(frozen=True)
class VertebraPose:
    """Rigid motion of a vertebra from the straight spine: x -> rotation (x - before) + after."""

    tilt: float
    """Rotation in the coronal plane, positive towards +x going up [rad]."""
    pitch: float
    """Rotation in the sagittal plane, positive forward going up [rad]."""
    rotation: float
    """Rotation about the vertebra's own axis, positive from +x to +y [rad]."""
    axis: np.ndarray
    """The vertebra's own axis in the straight spine, a unit vector in the sagittal plane, shape (3,)."""
    before: np.ndarray
    """Centre of the vertebral body in the straight spine [mm], shape (3,)."""
    after: np.ndarray
    """Where that centre comes to lie [mm], shape (3,)."""

    @property
    def matrix(self) -> np.ndarray:
        """The rotation (3, 3): about the vertebra's own axis, then in the sagittal and in the coronal plane."""
        turn = RigidMotion.exp(np.append(self.rotation * self.axis, np.zeros(3))).rotation
        return attitudes(self.tilt, self.pitch) @ turn

    @property
    def still(self) -> bool:
        """Whether the vertebra does not move at all."""
        return self.tilt == self.pitch == self.rotation == 0.0 and bool((self.before == self.after).all())

    @property
    def motion(self) -> RigidMotion:
        """The same as a rigid motion [mm]."""
        return RigidMotion.about(self.matrix, self.before, self.after)

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Points of the vertebra, shape (n, 3) [mm], after the motion."""
        if self.still:
            return points.copy()
        return (points - self.before) @ self.matrix.T + self.after


def vertebra_poses(straight: Landmarks, curve: SpineCurve | MeasuredSpine) -> dict[str, VertebraPose]:
    """The motion of each vertebra T1 to L5 that gives a straight spine the curve.

    Body centres keep their distances along the spine, so that a curved spine is shorter. Each body turns with the
    tangent of the centre line, and about its own axis. The foot of L5 stays where it is, and T1 stays as far
    forward as it was: where the pitches would take it elsewhere, the spine leans as a whole above the sacrum.

    Args:
        straight: landmarks of an upright spine without coronal deformity, with both endplates of T1 to L5.
        curve: the deformity.

    Raises:
        InputError: a missing endplate landmark, or vertebrae that are not in order from top to bottom.
    """
    ends = endplates_of(straight)
    centres = ends.mean(axis=1)  # (17, 3), T1 first
    foot = ends[-1, 1]
    if not (np.diff([*centres[:, 2], foot[2]]) < 0.0).all():
        raise InputError("landmarks: vertebral bodies must lie one above the other, T1 highest, L5 lowest")

    from scipy.interpolate import PchipInterpolator
    from scipy.optimize import brentq

    angles = curve.angles(spine_of(straight))
    nodes = np.vstack([foot, centres[::-1]])
    z = np.linspace(foot[2], centres[0, 2], 2001)
    along = np.gradient(PchipInterpolator(nodes[:, 2], nodes[:, 1])(z), z)  # dy/dz of the straight centre line
    lean = np.clip((z - foot[2]) / (centres[-3, 2] - foot[2]), 0.0, 1.0)  # the whole of it above L3

    def profile(values: np.ndarray) -> np.ndarray:
        return PchipInterpolator(nodes[:, 2], [0.0, *values[::-1]])(z)

    tilts, pitches, turns = profile(angles.tilt), profile(angles.pitch), profile(angles.turn)

    def displaced(tilts: np.ndarray, pitches: np.ndarray) -> np.ndarray:
        """How far each point of the centre line is from its place in the straight spine [mm], shape (z, 3)."""
        y = along * np.cos(pitches) - np.sin(pitches)
        up = along * np.sin(pitches) + np.cos(pitches)
        slope = np.column_stack([np.sin(tilts) * up, y - along, np.cos(tilts) * up - 1.0])
        step = (slope[1:] + slope[:-1]) / 2 * (z[1] - z[0])
        return np.vstack([np.zeros(3), np.cumsum(step, axis=0)])

    if angles.pitch.any():
        pitches += lean * brentq(lambda p: displaced(tilts, pitches + p * lean)[-1, 1], -1.2, 1.2)
    if angles.top is not None:
        top = angles.top
        tilts += lean * brentq(lambda t: displaced(tilts + t * lean, pitches)[-1, 0] - top, -0.6, 0.6)
    way = displaced(tilts, pitches)

    poses = {}
    for name, (top_end, bottom), centre in zip(VERTEBRAE, ends, centres, strict=True):
        axis = unit((top_end - bottom) * [0.0, 1.0, 1.0])
        tilt, pitch, turn, *moved = (float(np.interp(centre[2], z, f)) for f in (tilts, pitches, turns, *way.T))
        poses[name] = VertebraPose(tilt, pitch, turn, axis, centre, centre + np.array(moved))
    return poses


def endplates_of(landmarks: Landmarks) -> np.ndarray:
    """Superior and inferior endplate centres of T1 to L5 [mm], shape (17, 2, 3).

    Raises:
        InputError: one of them is missing.
    """
    names = [f"{bone}_{end}_endplate" for bone in VERTEBRAE for end in ("superior", "inferior")]
    if missing := [name for name in names if name not in landmarks.names]:
        raise InputError(f"landmarks: '{missing[0]}' is missing; a spine curve needs both endplates of T1 to L5")
    return landmarks.points[[landmarks.index(name) for name in names]].reshape(LEVELS, 2, 3)


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredSpine:
    """The shape of a real spine; sizes are those of the anatomy on which it is imposed."""

    name: str
    """Its name."""
    tilt: np.ndarray
    """Coronal tilt of the centre line at T1 to L5, positive towards +x going up [rad], shape (17,)."""
    pitch: np.ndarray
    """Sagittal tilt of the centre line, positive forward going up [rad], shape (17,); NaN where it is unknown."""
    turn: np.ndarray
    """Axial rotation, positive from +x to +y [rad], shape (17,)."""
    continued: tuple[str, ...] = ()
    """Levels that were not measured; the curve fades out over them."""

    def __str__(self) -> str:
        return f"spine {self.name}"

    @property
    def shoulders(self) -> float:
        """How much higher the right shoulder stands [mm]: nothing is known of it, so it stays as it was."""
        return 0.0

    def corrected(self, fraction: float) -> MeasuredSpine:
        """The spine after a fraction in [0, 1] of tilt and axial rotation is corrected; the profile stays.

        Raises:
            InputError: a fraction outside [0, 1].
        """
        left = left_after(fraction)
        return replace(self, tilt=left * self.tilt, turn=left * self.turn)

    def angles(self, straight: Spine) -> SpineAngles:
        """The turns of each vertebra from the straight spine."""
        centres = straight.centroids[[straight.levels.index(level) for level in VERTEBRAE]]
        own = np.arctan2(*(np.gradient(centres[:, axis]) * sign for axis, sign in ((1, 1.0), (2, -1.0))))
        has_pitch = ~np.isnan(self.pitch)
        pitch = np.where(has_pitch, self.pitch - own, 0.0)
        first = int(has_pitch.argmax())
        pitch[:first] = pitch[first]
        pitch -= pitch[-1]  # the sacrum stays, and how a spine leans as a whole is not known of a scan taken lying
        return SpineAngles(tilt=self.tilt, pitch=pitch, turn=self.turn)


def read_measured_spine(path: str | Path) -> MeasuredSpine:
    """Read points of vertebrae in mm and LPS, such as `T4_body`, `T4_left_pedicle`, `T4_right_pedicle` down to L5.

    Each track is smoothed along the spine, since single key points are off by millimetres. Rotation is taken
    against the mean of both ends: there is no pelvis in the file. The curve fades out over levels above the
    highest one.

    Raises:
        InputError: a file that cannot be read, a row that is no point, or as `spine_of_marks`.
    """
    path = Path(path)
    spine = spine_of_marks(read_landmarks(path), str(path))
    assert spine.across is not None  # of points of vertebrae
    return measured_spine(path.stem, spine.line, np.arctan2(spine.across[:, 1], spine.across[:, 0]))


def measured_spine(name: str, body: np.ndarray, turn: np.ndarray) -> MeasuredSpine:
    """A spine from the centres of its lowest vertebral bodies and their axial rotation, see `read_measured_spine`.

    Args:
        name: its name.
        body: centres down to L5, the highest first, shape (n, 3) [mm].
        turn: axial rotation of each, positive from +x to +y [rad], shape (n,).
    """
    x, y, z = -smooth_track(body, body).derivative()(arc_length(body)).T  # going up
    tilt, pitch = np.arctan2(x, z), np.arctan2(-y, np.hypot(x, z))
    turn = smooth_track(body, turn)(arc_length(body))
    turn -= 0.5 * (turn[0] + turn[-1])
    above = LEVELS - len(body)
    fade = np.arange(1, above + 1) / (above + 1)
    tilt[-1] *= LUMBOSACRAL
    return MeasuredSpine(
        name=name,
        tilt=np.concatenate([tilt[0] * fade, tilt]),
        pitch=np.concatenate([np.full(above, math.nan), pitch]),
        turn=np.concatenate([turn[0] * fade, turn]),
        continued=VERTEBRAE[:above],
    )


_SMOOTH = 3000.0
"""Weight of the integrated squared curvature in the smoothing of a track [mm^3]: of errors that alternate from
level to level it leaves a tenth, of a curve over seven levels 97 %."""


def smooth_track(line: np.ndarray, values: np.ndarray) -> BSpline:
    """Values (n, ...) at the points of a line (n, 3) as smooth as a spine is, over the way along it."""
    from scipy.interpolate import make_smoothing_spline  # heavy

    return make_smoothing_spline(arc_length(line), values, lam=_SMOOTH)
