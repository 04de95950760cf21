"""Trunk shift: how far the top of the spine stands beside and in front of the sacrum."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .spine import asis_axis

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks

    from .spine import Spine


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
