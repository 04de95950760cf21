"""Angles of the spine, from the front (Cobb angles) and from the side, and its height."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from warp_trunk.case.landmarks import Landmarks

from .spine import Spine, spine_of

LEAST_CURVE = 10.0
"""A curve of less than this is not scoliosis [degrees], the threshold of the Scoliosis Research Society."""


@dataclass(frozen=True)
class CobbAngle:
    """One curve of a spine in the coronal plane."""

    angle: float
    """Angle between the end vertebrae [degrees], positive."""
    upper: str
    """Upper end vertebra, the one most tilted at the top of the curve."""
    lower: str
    """Lower end vertebra."""
    apex: str
    """The vertebra between them that stands furthest from the line through their centroids."""
    convex: Literal["left", "right"]
    """The patient's side to which the curve bulges."""

    @property
    def ends(self) -> str:
        """Its level in tables: both end vertebrae, such as T5-T12."""
        return f"{self.upper}-{self.lower}"


def cobb_angles(landmarks: Landmarks) -> tuple[CobbAngle, ...]:
    """Every curve of at least `LEAST_CURVE` degrees, top to bottom.

    The tilt of a vertebra is that of its axis, inferior to superior endplate centre, seen from the front (the
    coronal plane, x and z); for a vertebra whose endplates are perpendicular to its axis this is the
    construction of Cobb (1948), lines along the upper endplate of the upper and the lower endplate of the
    lower end vertebra. End vertebrae are where the tilt turns round, so that each curve is as large as it can
    be. Vertebrae without both endplates are passed over.
    """
    return curves_of(spine_of(landmarks))


def curves_of(spine: Spine) -> tuple[CobbAngle, ...]:
    """`cobb_angles` of a spine."""
    complete = np.flatnonzero(np.isfinite(spine.endplates).all(axis=(1, 2)))
    if len(complete) < 2:
        return ()
    levels = [spine.levels[i] for i in complete]
    tilt = vertebral_tilt(spine.endplates[complete])
    centroids = spine.centroids[complete]
    curves = []
    ends = _turning_points(tilt.tolist())
    for upper, lower in pairwise(ends):
        apex, convex = _apex(centroids[upper : lower + 1, [0, 2]])
        curves.append(
            CobbAngle(
                angle=float(abs(tilt[upper] - tilt[lower])),
                upper=levels[upper],
                lower=levels[lower],
                apex=levels[upper + apex],
                convex=convex,
            )
        )
    return tuple(curves)


def curves_after(curves: Sequence[CobbAngle], after: Landmarks) -> tuple[float | None, ...]:
    """Cobb angle of each curve once the spine has moved, between the end vertebrae that it had before.

    A surgeon follows a curve between the same two vertebrae, though after a correction others may tilt more.

    Args:
        curves: those before.
        after: the landmarks after.

    Returns:
        Degrees, negative where the spine bends to the other side now; None where an endplate has no landmark.
    """
    return angles_between(curves, spine_of(after))


def angles_between(curves: Sequence[CobbAngle], spine: Spine) -> tuple[float | None, ...]:
    """`curves_after` of a spine."""
    angles = (coronal_angle(spine, curve.upper, curve.lower) for curve in curves)
    return tuple(
        None if angle is None else angle if curve.convex == "right" else -angle
        for curve, angle in zip(curves, angles, strict=True)
    )


def coronal_angle(spine: Spine, upper: str, lower: str) -> float | None:
    """Angle between the axes of two vertebrae, seen from the front.

    Args:
        spine: vertebrae with their endplates [mm].
        upper: name of a vertebra.
        lower: name of one below it.

    Returns:
        Degrees, positive where the spine between them is convex to the right; None where an endplate is missing.
    """
    tilt = vertebral_tilt(np.array([spine.endplates_of(level) for level in (upper, lower)]))
    angle = float(tilt[0] - tilt[1])
    return angle if np.isfinite(angle) else None


def vertebral_tilt(endplates: np.ndarray) -> np.ndarray:
    """Coronal tilt of each vertebra's axis [degrees], positive to the patient's left, shape (...).

    endplates: superior and inferior endplate centres [mm], shape (..., 2, 3).
    """
    axis = endplates[..., 0, :] - endplates[..., 1, :]
    return np.degrees(np.arctan2(axis[..., 0], axis[..., 2]))


def tilts_of(spine: Spine) -> dict[str, float | None]:
    """Coronal tilt of the axis of each vertebra by level [degrees], positive to the patient's right.

    That of T1 is T1 tilt, that of the lowest instrumented vertebra LIV tilt (O'Brien et al. 2008), here of the
    axis between the endplate centres as `cobb_angles` has it.

    Args:
        spine: vertebrae with their endplates [mm].

    Returns:
        Top to bottom; None where an endplate has no landmark.
    """
    tilts = (-vertebral_tilt(spine.endplates)).tolist()
    return {level: tilt if np.isfinite(tilt) else None for level, tilt in zip(spine.levels, tilts, strict=True)}


def disc_angles_of(tilts: Mapping[str, float | None]) -> dict[str, float | None]:
    """Tilt of each vertebra against the next one below [degrees]; that of the lowest instrumented vertebra is the
    LIV disc angle (O'Brien et al. 2008) where the wedging of both vertebrae is small.

    Args:
        tilts: of vertebrae from the top down (`tilts_of`).
    """
    pairs = pairwise(tilts.items())
    return {level: None if tilt is None or below is None else tilt - below for (level, tilt), (_, below) in pairs}


def _turning_points(tilt: list[float]) -> list[int]:
    """Indices where the tilt turns round by at least `LEAST_CURVE`, its two ends included; or none."""
    low = high = 0
    ends: list[int] = []
    rising: bool | None = None
    for i in range(1, len(tilt)):
        if rising is not True and tilt[i] < tilt[low]:
            low = i
        if rising is not False and tilt[i] > tilt[high]:
            high = i
        if rising is None and tilt[high] - tilt[low] >= LEAST_CURVE:
            rising = low < high
            ends.append(low if rising else high)
        elif rising is True and tilt[high] - tilt[i] >= LEAST_CURVE:
            ends.append(high)
            rising, low = False, i
        elif rising is False and tilt[i] - tilt[low] >= LEAST_CURVE:
            ends.append(low)
            rising, high = True, i
    if rising is not None:
        ends.append(high if rising else low)
    return ends


def _apex(points: np.ndarray) -> tuple[int, Literal["left", "right"]]:
    """The point (x, z) furthest aside of the chord, and the side on which it lies."""
    chord = points[-1] - points[0]  # downwards
    aside = points - points[0]
    distance = (aside[:, 1] * chord[0] - aside[:, 0] * chord[1]) / np.hypot(*chord)  # positive to +x, left
    apex = int(np.argmax(np.abs(distance)))
    return apex, "left" if distance[apex] > 0.0 else "right"


KYPHOSIS = {"T1-T12": ("T1", "T12"), "T5-T12": ("T5", "T12")}
LORDOSIS = {"L1-L5": ("L1", "L5"), "L1-S1": ("L1", "S1")}
"""Upper and lower vertebra of each angle, by its name."""


def kyphosis(spine: Spine) -> dict[str, float | None]:
    """How far the thoracic spine bends forward, between the axes of two vertebrae [degrees], by `KYPHOSIS`.

    The sagittal Cobb angle of T5 to T12, as the Lenke classification grades it (J Bone Joint Surg Am 2001,
    83:1169), and of T1 to T12; here between the axes of the vertebrae, endplate centre to endplate centre, as
    `cobb_angles` has it. Lines along the outer endplates, as on a film, give half the wedging of the two more.

    Args:
        spine: vertebrae with their endplates [mm].

    Returns:
        By name, positive where the back is round; None where an endplate has no landmark.
    """
    return {name: sagittal_angle(spine, upper, lower) for name, (upper, lower) in KYPHOSIS.items()}


def lordosis(spine: Spine) -> dict[str, float | None]:
    """How far the lumbar spine bends backward, between the axes of two vertebrae [degrees], by `LORDOSIS`.

    Measured as `kyphosis` is, positive where the small of the back is hollow. On films lumbar lordosis is that
    of L1 to S1 (Stagnara et al., Spine 1982, 7:335); the axis of S1 is known only where the sacrum has
    landmarks at the centres of both endplates of S1.
    """
    angles = {name: sagittal_angle(spine, upper, lower) for name, (upper, lower) in LORDOSIS.items()}
    return {name: None if angle is None else -angle for name, angle in angles.items()}


def sagittal_angle(spine: Spine, upper: str, lower: str) -> float | None:
    """How much further back the axis of the lower vertebra leans than that of the upper one, from the side.

    Args:
        spine: vertebrae with their endplates [mm].
        upper: name of a vertebra.
        lower: name of one below it; S1 is that of the sacrum.

    Returns:
        Degrees, positive for a kyphosis, negative for a lordosis; None where an endplate has no landmark.
    """
    tilt = [sagittal_tilt(spine.endplates_of(level)) for level in (upper, lower)]
    angle = float(tilt[1] - tilt[0])
    return angle if np.isfinite(angle) else None


def sagittal_tilt(endplates: np.ndarray) -> np.ndarray:
    """Tilt of each vertebra's axis seen from the side [degrees], positive where it leans back, shape (...).

    endplates: superior and inferior endplate centres [mm], shape (..., 2, 3).
    """
    axis = endplates[..., 0, :] - endplates[..., 1, :]
    return np.degrees(np.arctan2(axis[..., 1], axis[..., 2]))


@dataclass(frozen=True)
class SpineHeight:
    """Height of the spine: what an operation that straightens it adds to the patient's own."""

    height: float
    """From the lower end to the upper one along the vertical [mm]."""
    upper: str
    """The vertebra whose upper endplate is the upper end."""
    lower: str
    """The lower end: S1 for its upper endplate, or L5 for its lower one."""


def spine_height(spine: Spine) -> SpineHeight | None:
    """Vertical distance between the centres of the upper endplates of T1 and S1.

    Spinal height T1-S1 of the Radiographic Measurement Manual (O'Brien et al. 2008). Where the sacrum
    has no landmarks the lower endplate of L5 stands in for that of S1, without the disc between them.

    Args:
        spine: vertebrae with their endplates [mm].

    Returns:
        None where T1, or both S1 and L5, have no landmark there.
    """
    top = spine.endplates_of("T1")[0, 2]
    for lower, end in (("S1", 0), ("L5", 1)):
        height = float(top - spine.endplates_of(lower)[end, 2])
        if np.isfinite(height):
            return SpineHeight(height, "T1", lower)
    return None
