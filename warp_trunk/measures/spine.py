"""Spine and pelvis from the landmarks, gathered once for all measures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.errors import InputError

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks

ENDPLATES = ("superior_endplate", "inferior_endplate")


@dataclass(frozen=True, eq=False)
class Spine:
    """The vertebrae that have landmarks, top to bottom; a point that has none is NaN."""

    levels: tuple[str, ...]
    """Their names."""
    centroids: np.ndarray
    """Mean of each vertebra's landmarks [mm], shape (levels, 3)."""
    endplates: np.ndarray
    """Superior and inferior endplate centres [mm], shape (levels, 2, 3)."""
    pedicles: np.ndarray
    """Left and right pedicles, each the mean of its upper and lower point [mm], shape (levels, 2, 3)."""
    sacrum: np.ndarray
    """Superior and inferior endplate centre of S1 [mm], shape (2, 3)."""

    def endplates_of(self, level: str) -> np.ndarray:
        """Superior and inferior endplate centre of a vertebra, or of S1 [mm], shape (2, 3); NaN where missing."""
        if level == "S1":
            return self.sacrum
        return self.endplates[self.levels.index(level)] if level in self.levels else np.full((2, 3), np.nan)


def spine_of(landmarks: Landmarks) -> Spine:
    """The spine of a set of landmarks."""
    levels = landmarks.vertebrae()
    bones: dict[str, dict[str, np.ndarray]] = {}
    for name, point in zip(landmarks.names, landmarks.points, strict=True):
        bone, _, place = name.partition("_")
        bones.setdefault(bone, {})[place] = point
    missing = np.full(3, np.nan)

    def gather(names: Sequence[str], places: Sequence[str]) -> np.ndarray:
        found = [bones.get(name, {}).get(place, missing) for name in names for place in places]
        return np.array(found).reshape(len(names), len(places), 3)

    sacrum = next((bone for bone in ("S1", "sacrum") if "superior_endplate" in bones.get(bone, {})), "S1")
    sides = [f"{side}_pedicle_{end}" for side in ("left", "right") for end in ("superior", "inferior")]
    centroids = [np.mean(list(bones[level].values()), axis=0) for level in levels]
    return Spine(
        levels=levels,
        centroids=np.array(centroids).reshape(-1, 3),
        endplates=gather(levels, ENDPLATES),
        pedicles=0.5 * gather(levels, sides).reshape(-1, 2, 2, 3).sum(axis=2),
        sacrum=gather([sacrum], ENDPLATES)[0],
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
