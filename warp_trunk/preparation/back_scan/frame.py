"""The size of a patient and the frame of her pelvis, from the markers on her back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.measures.markers import BackMarkers

from .body import StraightBody
from .spine import PlacedSpine

BESIDE = 0.5
"""Of the way that L5 lies beside its place above the markers, what the pelvis goes with it: markers on the skin
and the registration of films are both off by a centimetre and more."""
FURTHEST = np.array([30.0, 30.0, 30.0])
"""The pelvis goes with L5 sideways, back and up by no more than this [mm]."""


@dataclass(frozen=True, eq=False)
class PelvisFrame:
    """Patient positions p and those q of the scaled straight body: p = rotation q + shift."""

    rotation: np.ndarray
    """Shape (3, 3)."""
    shift: np.ndarray
    """Shape (3,) [mm]."""
    scale: float
    """Size of the patient over that of the body."""
    moved: np.ndarray
    """How far the pelvis went to the left, back and up from where the markers put it, to lie under L5 [mm]."""

    def to_body(self, points: np.ndarray) -> np.ndarray:
        """Points of the patient (n, 3) in the frame of the scaled body."""
        return (points - self.shift) @ self.rotation

    def to_patient(self, points: np.ndarray) -> np.ndarray:
        """Points of the scaled body (n, 3) in the frame of the patient."""
        return points @ self.rotation.T + self.shift


def find_frame(body: StraightBody, markers: BackMarkers, placed: PlacedSpine) -> PelvisFrame:
    """The frame that holds the pelvis square to the iliac spines, and the size of the patient.

    The body is scaled so that T1 begins at the height of C7 on the skin, for a spine as curved as hers. Turn
    and sideways tilt are those of the markers; the pelvis lies under L5 (`BESIDE`, `FURTHEST`).

    Args:
        body: as it is.
        markers: of the patient.
        placed: the patient's vertebrae.
    """
    from scipy.spatial.transform import Rotation  # heavy

    axis = markers.left - markers.right
    yaw, roll = np.arctan2(axis[1], axis[0]), np.arctan2(axis[2], np.hypot(axis[0], axis[1]))
    level = Rotation.from_euler("zy", [yaw, -roll])
    pair = body.pair(markers.pair).mean(axis=0)
    scale = float((markers.c7 - markers.middle)[2] / (body.endplates[0, 0] - pair)[2])
    scale *= longer_than_high(placed.centres) / longer_than_high(body.centres)
    off = level.inv().apply(placed.centres[-1] - markers.middle) - scale * (body.centres[-1] - pair)
    moved = np.clip(off * [BESIDE, 1.0, 1.0], -FURTHEST, FURTHEST)
    shift = markers.middle + level.apply(moved - scale * pair)
    return PelvisFrame(level.as_matrix(), shift, scale, moved)


def longer_than_high(centres: np.ndarray) -> float:
    """Length of a spine (n, 3) along its middles over its height."""
    return float(np.linalg.norm(np.diff(centres, axis=0), axis=1).sum() / np.ptp(centres[:, 2]))


OFF_SCAN = 20.0
"""A marker of the back is not farther from the scan than this [mm]."""


def check_on_scan(marks: Landmarks, points: np.ndarray, what: str = "markers") -> None:
    """InputError for a marker of the back that is not on the scan, with its distance."""
    from scipy.spatial import KDTree  # heavy

    names = [name for name in marks.names if not name.lower().startswith("asis")]
    off = np.asarray(KDTree(points).query(np.array([marks.point(name) for name in names]))[0])
    worst = int(off.argmax())
    if not off[worst] <= OFF_SCAN:
        cure = "give markers and scan in one frame, both in mm"
        raise InputError(
            f"{what}: '{names[worst]}' is {off[worst]:.0f} mm from the scan, {OFF_SCAN:g} mm is the most; {cure}"
        )
