"""What the landmarks say of the spine and the pelvis, gathered once for all measures."""

from __future__ import annotations

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
    rows: dict[str, dict[str, int]] = {}
    for row, name in enumerate(landmarks.names):
        bone, _, point = name.partition("_")
        rows.setdefault(bone, {})[point] = row
    levels = landmarks.vertebrae()
    points = np.vstack([landmarks.points, np.full(3, np.nan)])  # the last row is what is missing

    def gather(bones: tuple[str, ...], *names: str) -> np.ndarray:
        return points[[[rows[bone].get(name, -1) for name in names] for bone in bones]]

    sacrum = next((bone for bone in ("S1", "sacrum") if "superior_endplate" in rows.get(bone, {})), None)
    s1 = np.full((2, 3), np.nan) if sacrum is None else gather((sacrum,), *ENDPLATES)[0]
    if not levels:
        return Spine((), np.empty((0, 3)), np.empty((0, 2, 3)), np.empty((0, 2, 3)), s1)
    sides = [
        gather(levels, f"{side}_pedicle_superior", f"{side}_pedicle_inferior").mean(axis=1)
        for side in ("left", "right")
    ]
    return Spine(
        levels=levels,
        centroids=np.array([landmarks.points[list(rows[level].values())].mean(axis=0) for level in levels]),
        endplates=gather(levels, *ENDPLATES),
        pedicles=np.stack(sides, axis=1),
        sacrum=s1,
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
