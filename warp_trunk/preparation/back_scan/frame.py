"""The markers on a back, the size of the patient, and the frame of her pelvis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError

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
_PAIRS = ("asis", "psis")


@dataclass(frozen=True, eq=False)
class BackMarkers:
    """The markers of a trunk."""

    c7: np.ndarray
    """The seventh cervical vertebra on the skin [mm], shape (3,)."""
    pair: str
    """psis or asis: the iliac spines that hold the pelvis."""
    left: np.ndarray
    """The left one on the skin [mm], shape (3,)."""
    right: np.ndarray
    """The right one on the skin [mm], shape (3,)."""

    @property
    def middle(self) -> np.ndarray:
        """Midway between the iliac spines [mm], shape (3,)."""
        return 0.5 * (self.left + self.right)


def back_markers(marks: Landmarks, what: str = "markers") -> BackMarkers:
    """The markers by their names, in any case of letters: C7, and PSIS_left and PSIS_right or ASIS_left and so on.

    Where both pairs are given the anterior one holds the pelvis, as rotations are measured against it.

    Raises:
        InputError: a marker is missing, left and right are exchanged, or C7 is not above the pelvis.
    """
    found = {name.lower(): point for name, point in zip(marks.names, marks.points, strict=True)}
    there = ", ".join(marks.names) or "none"
    pair = next((one for one in _PAIRS if {f"{one}_left", f"{one}_right"} <= found.keys()), None)
    if "c7" not in found or pair is None:
        needed = "C7, PSIS_left and PSIS_right (or ASIS_left and ASIS_right)"
        raise InputError(f"{what}: needs {needed}, and has {there}; add what is missing")
    left, right = found[f"{pair}_left"], found[f"{pair}_right"]
    if not left[0] - right[0] > 0.5 * np.linalg.norm(left - right):
        rule = f"{pair.upper()}_left must lie left (+x) of {pair.upper()}_right"
        cure = "exchange the names, or turn the scan into LPS axes"
        raise InputError(f"{what}: {rule}, and lies at x = {left[0]:.0f} for {right[0]:.0f} mm; {cure}")
    rise = float(found["c7"][2] - max(left[2], right[2]))
    if not 150.0 <= rise <= 750.0:
        cure = "give mm and LPS axes, +z up"
        raise InputError(f"{what}: C7 must be 150 to 750 mm above the pelvis, and is {rise:.4g} mm; {cure}")
    return BackMarkers(found["c7"], pair, left, right)


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
