"""The spine of a patient as it was given, and the poses of the vertebrae of a body that it asks for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.case.landmarks import VERTEBRA_POINTS, Landmarks, read_landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.section import arc_length
from warp_trunk.io.file_access import read_text
from warp_trunk.io.point_files import read_points
from warp_trunk.measures.back import TURN, vertebrae_on_line

from ..deformity.spine_curve import VertebraPose, smooth_track

TURN_SD = {"line": 6.0, "pedicles": 4.0, "landmarks": 3.0}
"""Standard deviation of the turn of a vertebra by what is known of the spine [degrees]."""
_FEWEST = 6
_EACH = 3.0
"""The smoothed line is sampled at this distance [mm]."""


@dataclass(frozen=True, eq=False)
class PatientSpine:
    """A spine in the frame of the scan: a line, or points of vertebrae."""

    kind: str
    """line, pedicles or landmarks."""
    line: np.ndarray
    """Through the middles of the vertebral bodies from top to bottom [mm], shape (n, 3)."""
    levels: tuple[str, ...] = ()
    """The vertebrae whose middles the points of the line are; none of a mere line."""
    up: np.ndarray | None = None
    """Axis of each of these vertebrae, shape (levels, 3), where both endplates are known."""
    across: np.ndarray | None = None
    """From the right to the left pedicle of each [mm], shape (levels, 3), where they are known."""


def read_patient_spine(path: str | Path, size: float = 1.0) -> PatientSpine:
    """Read a line (x,y,z), a table of bodies and pedicles (`T4_body`, `T4_left_pedicle`), or landmarks of films.

    Args:
        path: a CSV; points of a line from the top to the bottom.
        size: mm in a unit of the file.

    Raises:
        InputError: a file that cannot be read, too few points or levels, or a spine that runs upwards.
    """
    path = Path(path)
    titles = read_text(path, "a line (x,y,z) or named points (name,x,y,z) of the spine were expected")[:200]
    if "name" not in titles.split("\n")[0].lower() and path.suffix.lower() not in (".json", ".fcsv"):
        return spine_line(read_points(path) * size, str(path))
    marks = read_landmarks(path)
    return spine_of_marks(Landmarks(marks.names, marks.points * size), str(path))


def spine_line(points: np.ndarray, what: str = "spine") -> PatientSpine:
    """A spine of which only the line through the bodies is known, shape (n, 3) [mm], the highest point first.

    Raises:
        InputError: fewer than 6 points, or a line that does not run down.
    """
    if len(points) < _FEWEST:
        raise InputError(f"{what}: a line needs {_FEWEST} points, and has {len(points)}; give more of them")
    _check_down(points, what)
    return PatientSpine("line", points)


def spine_of_marks(marks: Landmarks, what: str = "spine") -> PatientSpine:
    """A spine from landmarks of its vertebrae: body and pedicles, or the six points of a case.

    Raises:
        InputError: levels that are no row of 8 or more down to L5, a missing point, or a spine that runs upwards.
    """
    levels = [level for level in VERTEBRAE if any(name.startswith(f"{level}_") for name in marks.names)]
    if len(levels) < 8 or tuple(levels) != VERTEBRAE[-len(levels) :]:
        found = ", ".join(levels) or "none"
        raise InputError(f"{what}: needs 8 or more levels in a row down to L5, and has {found}; give their points")
    six = f"{levels[0]}_{VERTEBRA_POINTS[0]}" in marks.names
    parts = VERTEBRA_POINTS if six else ("body", "left_pedicle", "right_pedicle")
    for name in (f"{level}_{part}" for level in levels for part in parts):
        if name not in marks.names:
            raise InputError(f"{what}: '{name}' is missing; each level needs {', '.join(parts)}")
    table = np.array([[marks.point(f"{level}_{part}") for part in parts] for level in levels])
    at = {part: table[:, column] for column, part in enumerate(parts)}
    if six:
        top, bottom = at["superior_endplate"], at["inferior_endplate"]
        left, right = (at[f"{s}_pedicle_superior"] + at[f"{s}_pedicle_inferior"] for s in ("left", "right"))
        spine = PatientSpine("landmarks", (top + bottom) / 2.0, tuple(levels), top - bottom, (left - right) / 2.0)
    else:
        spine = PatientSpine("pedicles", at["body"], tuple(levels), None, at["left_pedicle"] - at["right_pedicle"])
    _check_down(spine.line, what)
    if (spine.across is not None) and not (spine.across[:, 0] > 0.0).all():
        level = levels[int(spine.across[:, 0].argmin())]
        cure = "exchange the names, or turn the axes to LPS"
        raise InputError(f"{what}: the left pedicle of {level} must lie left (+x) of the right one; {cure}")
    return spine


def _check_down(points: np.ndarray, what: str) -> None:
    way = float(points[0, 2] - points[-1, 2])
    if way <= 0.0:
        cure = "give the highest point first"
        raise InputError(f"{what}: runs the other way, upwards by {-way:.0f} mm; {cure}, in LPS axes with +z up")
    if not 200.0 <= way <= 700.0:
        raise InputError(f"{what}: must run down by 200 to 700 mm, and runs {way:.4g} mm; give it in mm")
    rise = float(np.diff(points[:, 2]).max())
    if rise > 3.0:
        raise InputError(f"{what}: must run down, and rises by {rise:.0f} mm between two points; sort them")


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


def smoothed(line: np.ndarray) -> np.ndarray:
    """The line as smooth as a spine is, sampled evenly and continued straight at both ends, shape (n, 3) [mm]."""
    line = line[np.append(True, np.diff(arc_length(line)) > 1e-6)]
    long = arc_length(line)[-1]
    fine = smooth_track(line, line)(np.arange(0.0, long + _EACH, _EACH).clip(max=long))
    first = (fine[:4] - fine[4:8]).mean(axis=0)
    last = (fine[-4:] - fine[-8:-4]).mean(axis=0)
    steps = np.arange(1, 30)[:, None] * _EACH
    first, last = first / np.linalg.norm(first), last / np.linalg.norm(last)
    return np.vstack([fine[0] + steps[::-1] * first, fine, fine[-1] + steps * last])


def place_spine(
    spine: PatientSpine, markers: Landmarks, body: np.ndarray, rise: np.ndarray | float = 0.0
) -> PlacedSpine:
    """The vertebrae T1 to L5 of a patient, in the frame of the scan.

    On a mere line their centroids lie at the usual heights between the markers that `measure_back` has. Where
    levels are known they lie there; those above go on as in the body.

    Args:
        spine: of the patient.
        markers: C7 and iliac spines.
        body: middles of T1 to L5 of a straight body, shape (17, 3) [mm].
        rise: how far the centroid of the landmarks of each is above the middle of its body [mm], shape (17,).
    """
    if not spine.levels:
        fine = smoothed(spine.line)
        usual, slope, heights = vertebrae_on_line(fine, markers)[:, 2], np.gradient(fine, axis=0), -fine[:, 2]
        usual -= rise
        centres = np.column_stack([np.interp(-usual, heights, track) for track in fine.T])
        up = -np.column_stack([np.interp(-centres[:, 2], heights, track) for track in slope.T])
        return PlacedSpine(centres, up / np.linalg.norm(up, axis=1)[:, None], None)
    above, known = len(VERTEBRAE) - len(spine.levels), spine.line
    size = np.linalg.norm(np.diff(known, axis=0), axis=1).sum()
    size /= np.linalg.norm(np.diff(body[above:], axis=0), axis=1).sum()
    offset = size * (body[:above] - body[above])
    lean = (known[0] - known[2]) / np.linalg.norm(known[0] - known[2])
    own = (body[above] - body[above + 2]) / np.linalg.norm(body[above] - body[above + 2])
    centres = np.vstack([known[0] + offset + np.linalg.norm(offset, axis=1)[:, None] * (lean - own), known])
    up = -smooth_track(centres, centres).derivative()(arc_length(centres))
    if spine.up is not None:
        up[above:] = spine.up
    across = None
    if spine.across is not None:
        across = np.vstack([np.full((above, 3), np.nan), spine.across])
    return PlacedSpine(centres, up / np.linalg.norm(up, axis=1)[:, None], across)


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
        known = centres[above:]
        turn[above:] = smooth_track(known, turn[above:])(arc_length(known))
    turn[:above] = turn[above] * np.arange(1, above + 1) / (above + 1) if above < len(turn) else 0.0
    return turn


def poses_of(
    placed: PlacedSpine, turns: np.ndarray, centres: np.ndarray, axes: np.ndarray
) -> dict[str, VertebraPose]:
    """The motion of each vertebra of a straight body, with middles and axes (17, 3), to its place and turn."""
    found = {}
    for row, level in enumerate(VERTEBRAE):
        (x, y, z), own = placed.up[row], axes[row] * [0.0, 1.0, 1.0]
        tilt = float(np.arctan2(x, z))
        pitch = float(np.arctan2(-y, np.hypot(x, z)) - np.arctan2(-own[1], own[2]))
        before, after = centres[row], placed.centres[row]
        axis = own / np.linalg.norm(own)
        found[level] = VertebraPose(tilt, pitch, float(turns[row]), axis, before, after)
    return found
