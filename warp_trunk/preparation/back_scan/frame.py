"""The size of the patient, and the frame of her pelvis, in which the straight body is upright."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .body import StraightBody
from .markers import BackMarkers
from .spine import smoothed

BESIDE = 0.5
"""Of the way that L5 lies beside its place above the markers, what the pelvis goes with it: markers on the skin
and the registration of films are both off by a centimetre and more."""
DEEPER, SHALLOWER = 30.0, 20.0
"""The pelvis goes with L5 forwards and backwards by no more than this [mm]."""


@dataclass(frozen=True, eq=False)
class PelvisFrame:
    """Patient positions p and those q of the scaled straight body: p = rotation q + shift."""

    rotation: np.ndarray
    """Shape (3, 3)."""
    shift: np.ndarray
    """Shape (3,) [mm]."""
    scale: float
    """Size of the patient over that of the body."""
    moved: tuple[float, float]
    """How far the pelvis went to the left and back from where the markers put it, to lie under L5 [mm]."""

    def to_body(self, points: np.ndarray) -> np.ndarray:
        """Points of the patient (n, 3) in the frame of the scaled body."""
        return (points - self.shift) @ self.rotation

    def to_patient(self, points: np.ndarray) -> np.ndarray:
        """Points of the scaled body (n, 3) in the frame of the patient."""
        return points @ self.rotation.T + self.shift


def find_frame(body: StraightBody, markers: BackMarkers, line: np.ndarray) -> PelvisFrame:
    """The frame that holds the pelvis square to the iliac spines, and the size of the patient.

    The body is scaled so that its spine reaches from the height of the C7 marker, where T1 begins, to L5 above the
    iliac spines. Turn and sideways tilt are those of the markers; the pelvis lies under L5, see `BESIDE`.

    Args:
        body: as it is.
        markers: of the patient.
        line: through the vertebral bodies, from top to bottom [mm].
    """
    from scipy.spatial.transform import Rotation  # heavy

    pair = body.pair(markers.pair)
    axis = markers.left - markers.right
    yaw, roll = np.arctan2(axis[1], axis[0]), np.arctan2(axis[2], np.hypot(axis[0], axis[1]))
    level = Rotation.from_euler("zy", [yaw, -roll])
    fine = smoothed(line)
    down = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    foot = body.endplates[-1, 1] - pair.mean(axis=0)
    long = body.arcs[-1] + float(np.linalg.norm(body.endplates[-1, 1] - body.centres[-1]))
    start = float(np.interp(-markers.c7[2], -fine[:, 2], down))
    rise = float(markers.c7[2] - markers.middle[2]) / (long + foot[2])
    end = start
    for _ in range(20):  # the spine is longer than its height
        end = float(np.interp(-(markers.middle[2] + rise * foot[2]), -fine[:, 2], down))
        rise = (end - start) / long
    at = np.array([np.interp(end, down, track) for track in fine.T]) - markers.middle
    off = level.inv().apply(at) - rise * foot
    aside, back = BESIDE * off[0], float(np.clip(off[1], -DEEPER, rise * SHALLOWER))
    shift = markers.middle - level.apply(rise * pair.mean(axis=0) - [aside, back, 0.0])
    return PelvisFrame(level.as_matrix(), shift, rise, (float(aside), back))
