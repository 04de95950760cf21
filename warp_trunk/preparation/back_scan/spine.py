"""Where the spine of a patient places the vertebrae of a body, and how it turns them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.geometry.section import arc_length
from warp_trunk.geometry.surface import unit
from warp_trunk.measures.back import TURN, vertebrae_on_line
from warp_trunk.measures.markers import BackMarkers

from ..deformity.patient_spine import PatientSpine
from ..deformity.spine_curve import VertebraPose, smooth_track

TURN_SD = {"line": 6.0, "pedicles": 4.0, "landmarks": 3.0}
"""Standard deviation of the turn of a vertebra by what is known of the spine [degrees]."""
_SAMPLE_DISTANCE = 3.0
"""The smoothed line is sampled at this distance [mm]."""


@dataclass(frozen=True, eq=False)
class PlacedSpine:
    """Where the vertebrae T1 to L5 of a patient are."""

    centres: np.ndarray
    """Middles of the bodies [mm], shape (17, 3)."""
    up: np.ndarray
    """Axes of the vertebrae, of length 1, shape (17, 3)."""
    across: np.ndarray | None
    """From the right to the left pedicle, shape (17, 3); NaN or None where they are not known."""

    def turned(self, rotation: np.ndarray, shift: np.ndarray) -> PlacedSpine:
        """The vertebrae after x -> rotation (x - shift)."""
        across = None if self.across is None else self.across @ rotation.T
        return PlacedSpine((self.centres - shift) @ rotation.T, self.up @ rotation.T, across)


def smoothed_line(line: np.ndarray) -> np.ndarray:
    """The line as smooth as a spine is, sampled evenly and continued straight at both ends, shape (n, 3) [mm]."""
    line = line[np.append(True, np.diff(arc_length(line)) > 1e-6)]
    long = arc_length(line)[-1]
    fine = smooth_track(line, line)(np.arange(0.0, long + _SAMPLE_DISTANCE, _SAMPLE_DISTANCE).clip(max=long))
    first = unit((fine[:4] - fine[4:8]).mean(axis=0))
    last = unit((fine[-4:] - fine[-8:-4]).mean(axis=0))
    steps = np.arange(1, 30)[:, None] * _SAMPLE_DISTANCE
    return np.vstack([fine[0] + steps[::-1] * first, fine, fine[-1] + steps * last])


def place_spine(
    spine: PatientSpine, markers: BackMarkers, body: np.ndarray, rise: np.ndarray | float = 0.0
) -> PlacedSpine:
    """The vertebrae T1 to L5 of a patient, in the frame of the scan.

    On a mere line their centroids lie at the usual heights (`vertebrae_on_line`). Where
    levels are known they lie there; those above go on as in the body.

    Args:
        spine: of the patient.
        markers: on the back.
        body: middles of T1 to L5 of a straight body, shape (17, 3) [mm].
        rise: how far the centroid of the landmarks of each is above the middle of its body [mm], shape (17,).
    """
    if not spine.levels:
        fine = smoothed_line(spine.line)
        usual, slope, heights = vertebrae_on_line(fine, markers)[:, 2], np.gradient(fine, axis=0), -fine[:, 2]
        usual -= rise
        centres = np.column_stack([np.interp(-usual, heights, track) for track in fine.T])
        up = -np.column_stack([np.interp(-centres[:, 2], heights, track) for track in slope.T])
        return PlacedSpine(centres, unit(up), None)
    above, line = len(VERTEBRAE) - len(spine.levels), spine.line
    size = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
    size /= np.linalg.norm(np.diff(body[above:], axis=0), axis=1).sum()
    offset = size * (body[:above] - body[above])
    lean, own = unit(line[0] - line[2]), unit(body[above] - body[above + 2])
    centres = np.vstack([line[0] + offset + np.linalg.norm(offset, axis=1)[:, None] * (lean - own), line])
    up = -smooth_track(centres, centres).derivative()(arc_length(centres))
    if spine.up is not None:
        up[above:] = spine.up
    across = None
    if spine.across is not None:
        across = np.vstack([np.full((above, 3), np.nan), spine.across])
    return PlacedSpine(centres, unit(up), across)


def turns_of(placed: PlacedSpine, smooth: bool) -> np.ndarray:
    """Turn of each vertebra against the pelvis, in whose frame they are given, shape (17,) [rad].

    From the pedicles, which fade out over the levels above those that are known; or from the sideways way by
    `TURN`, where there are none.

    Args:
        placed: in the frame of the pelvis.
        smooth: whether errors of single pedicles are smoothed.
    """
    centres = placed.centres
    if placed.across is None:
        chord = np.interp(centres[:, 2], centres[[-1, 0], 2], centres[[-1, 0], 0])
        return np.radians(TURN * (centres[:, 0] - chord))
    turn = np.arctan2(placed.across[:, 1], placed.across[:, 0])
    above = int(np.isnan(turn).sum())
    if smooth:
        given_centres = centres[above:]
        turn[above:] = smooth_track(given_centres, turn[above:])(arc_length(given_centres))
    turn[:above] = turn[above] * np.arange(1, above + 1) / (above + 1) if above < len(turn) else 0.0
    return turn


def placed_poses(
    placed: PlacedSpine, turns: np.ndarray, centres: np.ndarray, axes: np.ndarray
) -> dict[str, VertebraPose]:
    """The motion of each vertebra of a straight body, with middles and axes (17, 3), to its place and turn."""
    poses = {}
    for row, level in enumerate(VERTEBRAE):
        (x, y, z), own = placed.up[row], axes[row] * [0.0, 1.0, 1.0]
        tilt = float(np.arctan2(x, z))
        pitch = float(np.arctan2(-y, np.hypot(x, z)) - np.arctan2(-own[1], own[2]))
        before, after = centres[row], placed.centres[row]
        poses[level] = VertebraPose(tilt, pitch, float(turns[row]), unit(own), before, after)
    return poses
