"""Spine and pelvis from the landmarks, gathered once for all measures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
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


@dataclass(frozen=True, eq=False)
class _Rows:
    """Which landmarks the points of a spine are; `_MISSING` where there is none."""

    own: np.ndarray
    """Those of each level, shape (levels, most); `_NONE` after the last."""
    count: np.ndarray
    """How many each level has, shape (levels, 1)."""
    endplates: np.ndarray
    """Shape (levels, 2)."""
    pedicles: np.ndarray
    """Left and right, of each the upper and the lower point, shape (levels, 2, 2)."""
    sacrum: np.ndarray
    """Shape (2,)."""


_MISSING, _NONE = -1, -2
"""Rows after the last landmark: one of NaN, one of zeros."""


def spine_of(landmarks: Landmarks) -> Spine:
    """The spine of a set of landmarks."""
    levels = landmarks.vertebrae()
    rows = _rows_of(landmarks.names, levels)
    points = np.concatenate([landmarks.points, np.zeros((1, 3)), np.full((1, 3), np.nan)])
    return Spine(
        levels=levels,
        centroids=points[rows.own].sum(axis=1) / rows.count,
        endplates=points[rows.endplates],
        pedicles=0.5 * points[rows.pedicles].sum(axis=2),
        sacrum=points[rows.sacrum],
    )


@lru_cache(maxsize=64)
def _rows_of(names: tuple[str, ...], levels: tuple[str, ...]) -> _Rows:
    """Found once for landmarks of these names, of which a patient has many sets."""
    bones: dict[str, dict[str, int]] = {}
    for row, name in enumerate(names):
        bone, _, point = name.partition("_")
        bones.setdefault(bone, {})[point] = row

    def gather(bone: str, *points: str) -> list[int]:
        return [bones[bone].get(point, _MISSING) for point in points]

    own = [list(bones[level].values()) for level in levels]
    most = max(map(len, own), default=0)
    sacrum = next((bone for bone in ("S1", "sacrum") if "superior_endplate" in bones.get(bone, {})), None)
    sides = [f"{side}_pedicle_{end}" for side in ("left", "right") for end in ("superior", "inferior")]
    return _Rows(
        own=np.array([[*rows, *[_NONE] * (most - len(rows))] for rows in own], dtype=int).reshape(len(own), most),
        count=np.array([len(rows) for rows in own]).reshape(-1, 1),
        endplates=np.array([gather(level, *ENDPLATES) for level in levels], dtype=int).reshape(-1, 2),
        pedicles=np.array([gather(level, *sides) for level in levels], dtype=int).reshape(-1, 2, 2),
        sacrum=np.array([_MISSING, _MISSING] if sacrum is None else gather(sacrum, *ENDPLATES)),
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
