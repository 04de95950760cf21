"""A scoliotic curve of the spine as a rigid motion of each vertebra."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from warp_trunk.case.landmarks import VERTEBRAE
from warp_trunk.errors import InputError

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from warp_trunk.case.landmarks import Landmarks

_ROTATION_PER_COBB = 0.32
"""Apical axial rotation over Cobb angle: 22 over 68 degrees, means of 62 upright patients before surgery
(thoracic curves; Brink et al. 2017, Scoliosis and Spinal Disorders 12:6, PMC5320720)."""

# Coronal tilt at vertebrae over the Cobb angle, from the sacrum (0) up: where it turns, and with which share.
# "+" and "-" are end vertebrae, p and p - 1, where p is found so that T1 stands over the sacrum; numbers are
# compensating tilts. A positive tilt leans to the convex side going up. Of 106 patients with a main thoracic curve
# of 55 degrees the upper one had 27 ± 8; T1 leaned by 3 ± 6 degrees away from the convex side, and clavicles by
# 3 ± 3 (BMC Musculoskeletal Disorders 2014;15:366).
_TILTS: dict[str, dict[str, float | str]] = {
    "thoracic": {"L4": -0.10, "T12": "+", "T5": "-", "T1": -0.10},
    "thoracolumbar": {"L3": "+", "T10": "-", "T5": 0.10, "T1": 0.0},
    "double_major": {"L4": "-", "T12": "+", "T5": "-", "T1": -0.10},
}
# Axial rotation over that of the main apex. The lumbar curve of a double major turns the other way, and less:
# 11 over 44 degrees in the same patients.
_ROTATIONS: dict[str, dict[str, float]] = {
    "thoracic": {"L2": 0.0, "T8": 1.0, "T3": 0.0},
    "thoracolumbar": {"L5": 0.0, "T12": 1.0, "T8": 0.0},
    "double_major": {"L5": 0.0, "L2": -0.78, "T12": 0.0, "T8": 1.0, "T3": 0.0},
}


@dataclass(frozen=True, kw_only=True)
class SpineCurve:
    """A scoliosis by the numbers a clinic gives; end vertebrae T5 to T12, T10 to L3, or T5 to T12 to L4."""

    kind: Literal["thoracic", "thoracolumbar", "double_major"] = "thoracic"
    """Where the curve is; a double major has a thoracic and an opposite lumbar curve of one Cobb angle."""
    cobb: float = 60.0
    """Angle in the coronal plane between the end vertebrae [deg], 0 to 120."""
    apical_rotation: float | None = None
    """Axial rotation of the apical vertebra, its body towards the convex side [deg], 0 to 60; 0.32 of the
    Cobb angle when left out."""
    direction: Literal["right", "left"] = "right"
    """The patient's side to which the curve is convex; of a double major, its thoracic curve."""

    def __post_init__(self) -> None:
        for field, allowed in (("kind", tuple(_TILTS)), ("direction", ("right", "left"))):
            if getattr(self, field) not in allowed:
                raise InputError(
                    f"curve: '{field}' must be one of {', '.join(allowed)}, not {getattr(self, field)!r}"
                )
        for field, most in (("cobb", 120.0), ("apical_rotation", 60.0)):
            value = getattr(self, field)
            if value is not None and not 0.0 <= value <= most:
                raise InputError(f"curve: '{field}' must be 0 to {most:g} degrees, not {value}")

    @property
    def rotation(self) -> float:
        """Axial rotation of the apical vertebra, given or by default [deg]."""
        return _ROTATION_PER_COBB * self.cobb if self.apical_rotation is None else self.apical_rotation

    def corrected(self, fraction: float) -> SpineCurve:
        """The curve that is left when a fraction in [0, 1] of Cobb angle and rotation is taken away.

        Raises:
            InputError: a fraction outside [0, 1].
        """
        if not 0.0 <= fraction <= 1.0:
            raise InputError(f"correction: the fraction must be between 0 and 1, not {fraction}")
        left = 1.0 - fraction
        return replace(self, cobb=left * self.cobb, apical_rotation=left * self.rotation)


@dataclass(frozen=True)
class Pose:
    """Rigid motion of a vertebra from the straight spine: x -> rotation (x - before) + after."""

    tilt: float
    """Rotation in the coronal plane, positive towards +x going up [rad]."""
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
        """The rotation (3, 3): about the vertebra's own axis first, then in the coronal plane."""
        c, s = math.cos(self.tilt), math.sin(self.tilt)
        lean = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        K = np.cross(np.eye(3), self.axis)  # K x = axis × x
        return lean @ (np.eye(3) + math.sin(self.rotation) * K + (1.0 - math.cos(self.rotation)) * (K @ K))

    @property
    def still(self) -> bool:
        """Whether the vertebra does not move at all."""
        return self.tilt == 0.0 and self.rotation == 0.0 and bool((self.before == self.after).all())

    @property
    def motion(self) -> RigidTransform:
        """The same as a rigid motion [mm]."""
        from scipy.spatial.transform import RigidTransform, Rotation  # heavy

        rotation = Rotation.from_matrix(self.matrix)
        return RigidTransform.from_components(self.after - rotation.apply(self.before), rotation)

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Points of the vertebra, shape (n, 3) [mm], after the motion."""
        if self.still:
            return points.copy()
        return (points - self.before) @ self.matrix.T + self.after


def vertebra_poses(straight: Landmarks, curve: SpineCurve) -> dict[str, Pose]:
    """The motion of each vertebra T1 to L5 that gives a straight spine the curve.

    Body centres keep their place from front to back and their distances along the spine; what was height
    becomes arc length in the coronal plane, so that a curved spine is shorter. Each body tilts with the
    tangent of the arc, and turns about its own axis. The foot of L5 stays where it is.

    Args:
        straight: landmarks of an upright spine without coronal deformity, with both endplates of T1 to L5.
        curve: the deformity.

    Raises:
        InputError: a missing endplate landmark, or vertebrae that are not in order from top to bottom.
    """
    ends = _endplates(straight)
    centres = ends.mean(axis=1)  # (17, 3), T1 first
    foot = ends[-1, 1]
    heights = dict(zip(VERTEBRAE, centres[:, 2], strict=True))
    if not (np.diff([*centres[:, 2], foot[2]]) < 0.0).all():
        raise InputError("landmarks: vertebral bodies must lie one above the other, T1 highest, L5 lowest")

    from scipy.interpolate import PchipInterpolator

    s = np.linspace(foot[2], heights["T1"], 2001)
    side = -1.0 if curve.direction == "right" else 1.0
    tilts = side * _tilts(curve, heights, s)
    ds = s[1] - s[0]
    slopes = np.column_stack([np.sin(tilts), np.cos(tilts) - 1.0])
    x, drop = np.vstack([[0.0, 0.0], np.cumsum((slopes[1:] + slopes[:-1]) / 2, axis=0) * ds]).T

    shares = _ROTATIONS[curve.kind]
    nodes = [foot[2], *(heights[name] for name in shares)]
    values = [0.0, *shares.values()]
    if "T1" not in shares:
        nodes, values = [*nodes, heights["T1"]], [*values, 0.0]
    turns = side * math.radians(curve.rotation) * PchipInterpolator(nodes, values)(s)

    poses = {}
    for name, (top, bottom), centre in zip(VERTEBRAE, ends, centres, strict=True):
        axis = (top - bottom) * [0.0, 1.0, 1.0]
        at = [np.interp(centre[2], s, f) for f in (tilts, turns, x, drop)]
        poses[name] = Pose(
            tilt=float(at[0]),
            rotation=float(at[1]),
            axis=axis / np.linalg.norm(axis),
            before=centre,
            after=centre + np.array([at[2], 0.0, at[3]]),
        )
    return poses


def _tilts(curve: SpineCurve, heights: Mapping[str, float], s: np.ndarray) -> np.ndarray:
    """Tilt to the convex side at heights s, from the foot up [radians], such that T1 stands above the foot.

    Args:
        curve: the deformity.
        heights: of the vertebral centres, by name.
        s: where, evenly, shape (heights,).
    """
    from scipy.interpolate import PchipInterpolator

    def profile(p: float) -> np.ndarray:
        share = {"+": p, "-": p - 1.0}
        nodes = {name: share[v] if isinstance(v, str) else v for name, v in _TILTS[curve.kind].items()}
        z = [s[0], *(heights[name] for name in nodes)]
        return math.radians(curve.cobb) * PchipInterpolator(z, [0.0, *nodes.values()])(s)

    low, high = 0.0, 1.0  # a larger p leans T1 further to the convex side
    for _ in range(60):
        p = (low + high) / 2
        low, high = (low, p) if np.sin(profile(p)).sum() > 0.0 else (p, high)
    return profile(low)


def _endplates(landmarks: Landmarks) -> np.ndarray:
    """Superior and inferior endplate centres of T1 to L5, shape (17, 2, 3)."""
    where = {name: i for i, name in enumerate(landmarks.names)}
    names = [[f"{bone}_{end}_endplate" for end in ("superior", "inferior")] for bone in VERTEBRAE]
    missing = [name for pair in names for name in pair if name not in where]
    if missing:
        raise InputError(f"landmarks: '{missing[0]}' is missing; a spine curve needs both endplates of T1 to L5")
    return landmarks.points[[[where[name] for name in pair] for pair in names]]
