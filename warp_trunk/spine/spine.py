"""Spine and pelvis from the landmarks, gathered once for all measures; how far the spine stands off the sacrum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError

from .endplate_smoothing import endplate_smoothing

ENDPLATES = ("superior_endplate", "inferior_endplate")


@dataclass(frozen=True, eq=False)
class Spine:
    """The vertebrae that have landmarks, top to bottom; a point that has none is NaN."""

    levels: tuple[str, ...]
    """Their names."""
    centroids: np.ndarray
    """Mean of each vertebra's landmarks [mm], shape (levels, 3)."""
    endplates: np.ndarray
    """Superior and inferior endplate centres [mm], shape (levels, 2, 3), smoothed along the spine where their
    landmarks have errors (`endplate_smoothing`)."""
    pedicles: np.ndarray
    """Left and right pedicles, each the mean of its upper and lower point [mm], shape (levels, 2, 3)."""
    sacrum: np.ndarray
    """Superior and inferior endplate centre of S1 [mm], shape (2, 3)."""
    endplate_error: float = 0.0
    """Standard deviation of the errors that were smoothed, each axis [mm]; 0 where endplates are as given."""

    def endplates_of(self, level: str) -> np.ndarray:
        """Superior and inferior endplate centre of a vertebra, or of S1 [mm], shape (2, 3); NaN where missing."""
        if level == "S1":
            return self.sacrum
        return self.endplates[self.levels.index(level)] if level in self.levels else np.full((2, 3), np.nan)


def spine_of(landmarks: Landmarks, expected_error: float = 0.0) -> Spine:
    """The spine of a set of landmarks.

    Args:
        landmarks: those of the spine [mm].
        expected_error: of landmarks that have none yet, see `endplate_smoothing` [mm].
    """
    levels = landmarks.vertebrae()
    bones: dict[str, dict[str, np.ndarray]] = {}
    for name, point in zip(landmarks.names, landmarks.points, strict=True):
        bone, _, place = name.partition("_")
        bones.setdefault(bone, {})[place] = point
    missing = np.full(3, np.nan)

    def gather(names: Sequence[str], places: Sequence[str]) -> np.ndarray:
        points = [bones.get(name, {}).get(place, missing) for name in names for place in places]
        return np.array(points).reshape(len(names), len(places), 3)

    sacrum = next((bone for bone in ("S1", "sacrum") if "superior_endplate" in bones.get(bone, {})), "S1")
    sides = [f"{side}_pedicle_{end}" for side in ("left", "right") for end in ("superior", "inferior")]
    centroids = [np.mean(list(bones[level].values()), axis=0) for level in levels]
    endplates = gather(levels, ENDPLATES)
    smoothing = endplate_smoothing(endplates, expected_error)
    return Spine(
        levels=levels,
        centroids=np.array(centroids).reshape(-1, 3),
        endplates=endplates if smoothing is None else smoothing.smoothed(endplates),
        pedicles=0.5 * gather(levels, sides).reshape(-1, 2, 2, 3).sum(axis=2),
        sacrum=gather([sacrum], ENDPLATES)[0],
        endplate_error=0.0 if smoothing is None else smoothing.error,
    )


def asis_axis(landmarks: Landmarks) -> np.ndarray:
    """Unit vector in the axial plane from the right to the left anterior superior iliac spine, shape (2,).

    Raises:
        InputError: 'asis_left' or 'asis_right' is missing or they coincide in the axial plane.
    """
    for name in ("asis_left", "asis_right"):
        if name not in landmarks.names:
            raise InputError(f"landmarks: '{name}' is missing; back surface rotation is measured against it")
    axis = landmarks.point("asis_left") - landmarks.point("asis_right")
    length = float(np.hypot(axis[0], axis[1]))
    if length < 1.0:
        raise InputError(
            f"landmarks: 'asis_left' and 'asis_right' are {length:.3g} mm apart seen from above; "
            "at least 1 mm is needed for an axis"
        )
    return axis[:2] / length


@dataclass(frozen=True, eq=False)
class SacralLine:
    """The vertical line through the middle of the sacrum, which the trunk ought to stand over."""

    point: np.ndarray
    """Where it is seen from above, x and y [mm], shape (2,)."""
    across: np.ndarray
    """Unit vector of the pelvis' axis to the patient's left, x and y, shape (2,)."""
    landmark: str
    """The landmark that it goes through: S1, sacrum, L5 (its lower endplate), or pelvis (midway between the
    iliac spines)."""


@dataclass(frozen=True)
class TrunkShift:
    """Coronal and sagittal balance."""

    lateral: float
    """Distance of the upper vertebra from the sacral line along the pelvis' axis [mm], positive to the right."""
    forward: float | None
    """Distance of the upper vertebra from the same line, across that axis [mm], positive to the front; None where
    nothing better than the middle of the pelvis is known, which lies far in front of the sacrum."""
    upper: str
    """The vertebra at the top, C7 or T1."""
    lower: str
    """The landmark of the sacral line, see `SacralLine`."""


def sacral_line(landmarks: Landmarks) -> SacralLine:
    """The central sacral vertical line, through the best landmark there is of those that `SacralLine` names.

    It is drawn through the middle of S1's upper endplate; the lower endplate of L5 is the nearest to it of the
    landmarks that every case has.

    Raises:
        InputError: no ASIS among the landmarks.
    """
    across = asis_axis(landmarks)
    best = (
        ("S1", "S1_superior_endplate"),
        ("S1", "S1_"),
        ("S1", "sacrum_superior_endplate"),
        ("sacrum", "sacrum_"),
    )
    for name, start in (*best, ("L5", "L5_inferior_endplate")):
        rows = [row for row, full in enumerate(landmarks.names) if full.startswith(start)]
        if rows:
            return SacralLine(landmarks.points[rows, :2].mean(axis=0), across, name)
    return SacralLine((landmarks.point("asis_left") + landmarks.point("asis_right"))[:2] / 2.0, across, "pelvis")


def trunk_length(landmarks: Landmarks, spine: Spine) -> float | None:
    """Height of the spinous process of C7 over the posterior superior iliac spines [mm].

    Trunk length of rasterstereography, vertebra prominens to the dimples (Drerup and Hierholzer, J Biomech 1987,
    20:961), along the vertical. The process of C7 is as high as the upper endplate of T1, the posterior spines as
    high as the anterior ones, both within 3 mm in seven bodies; they stand in for those without landmarks.

    Args:
        landmarks: with iliac spines [mm].
        spine: vertebrae [mm].

    Returns:
        None without T1.
    """
    foot = [landmarks.point(f"asis_{side}")[2] for side in ("left", "right")]
    length = float(spine.endplates_of("T1")[0, 2] - np.mean(foot))
    return length if np.isfinite(length) else None


def trunk_shift(spine: Spine, line: SacralLine) -> TrunkShift | None:
    """Distance of the plumb line of C7 from the central sacral vertical line, in both planes.

    Coronal balance of the Scoliosis Research Society, positive to the patient's right, and sagittal balance, the
    sagittal vertical axis, positive to the front; the latter to the middle of the sacrum's endplate, not to its
    posterior corner as on a film. Without landmarks of C7 the centroid of T1 stands in for it; without those the
    measure is missing.

    Args:
        spine: vertebrae [mm].
        line: see `sacral_line`.
    """
    upper = top_of_spine(spine)
    if upper is None:
        return None
    aside = spine.centroids[spine.levels.index(upper), :2] - line.point
    backward = float(aside @ np.array([-line.across[1], line.across[0]]))
    return TrunkShift(
        lateral=-float(aside @ line.across),
        forward=None if line.landmark == "pelvis" else -backward,
        upper=upper,
        lower=line.landmark,
    )


def top_of_spine(spine: Spine) -> str | None:
    """The vertebra whose plumb line measures balance: C7, or T1 where C7 has no landmarks; None without both."""
    return next((level for level in ("C7", "T1") if level in spine.levels), None)
