"""The spine of a patient as it was given, and the poses of the vertebrae of a body that it asks for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from warp_trunk.case.landmarks import VERTEBRA_POINTS, VERTEBRAE, Landmarks, read_landmarks
from warp_trunk.errors import InputError
from warp_trunk.io.file_access import read_text
from warp_trunk.io.point_files import read_points

from ..deformity.spine_curve import VertebraPose

TURN = 0.5
"""Turn of a vertebra for its sideways way from the line between T1 and L5 [degrees/mm]: 0.44 to 0.50 from the
spinous line against the body line of 30 patients at T8 to L2 (r 0.82 to 0.84), 0.5 to 0.6 of spines from CT."""
TURN_SD = {"line": 6.0, "pedicles": 4.0, "landmarks": 3.0}
"""Standard deviation of the turn of a vertebra by what is known of the spine [degrees]."""
_SMOOTH = 3000.0
"""Weight of the integrated squared curvature in the smoothing of a track [mm^3]."""
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

    def moved(self, rotation: np.ndarray, shift: np.ndarray) -> PatientSpine:
        """The spine after x -> rotation x + shift."""
        turned = [None if v is None else v @ rotation.T for v in (self.up, self.across)]
        return PatientSpine(self.kind, self.line @ rotation.T + shift, self.levels, *turned)


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
    turn: np.ndarray
    """Turn about the axis against the pelvis, positive from +x to +y [rad], shape (17,)."""


def smoothed(line: np.ndarray) -> np.ndarray:
    """The line as smooth as a spine is, sampled evenly and continued straight at both ends, shape (n, 3) [mm]."""
    from scipy.interpolate import make_smoothing_spline  # heavy

    down = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    kept = np.concatenate([[True], np.diff(down) > 1e-6])
    down, line = down[kept], line[kept]
    fits = [make_smoothing_spline(down, track, lam=_SMOOTH) for track in line.T]
    at = np.arange(0.0, down[-1] + _EACH, _EACH).clip(max=down[-1])
    fine = np.column_stack([fit(at) for fit in fits])
    first = (fine[:4] - fine[4:8]).mean(axis=0)
    last = (fine[-4:] - fine[-8:-4]).mean(axis=0)
    steps = np.arange(1, 30)[:, None] * _EACH
    first, last = first / np.linalg.norm(first), last / np.linalg.norm(last)
    return np.vstack([fine[0] + steps[::-1] * first, fine, fine[-1] + steps * last])


def place_on_line(line: np.ndarray, top: float, arcs: np.ndarray, scale: float) -> PlacedSpine:
    """The vertebrae along a line that is known without levels.

    Args:
        line: of `smoothed` [mm].
        top: height of the upper end of T1 [mm].
        arcs: distance along the spine of the body from the upper end of T1 to the middle of each vertebra [mm].
        scale: of the patient over the body.
    """
    down = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    start = float(np.interp(-top, -line[:, 2], down))
    places = start + scale * arcs
    centres = np.column_stack([np.interp(places, down, track) for track in line.T])
    slope = np.gradient(line, axis=0)
    up = -np.column_stack([np.interp(places, down, track) for track in slope.T])
    up /= np.linalg.norm(up, axis=1)[:, None]
    chord = np.interp(centres[:, 2], centres[[-1, 0], 2], centres[[-1, 0], 0])
    return PlacedSpine(centres, up, np.radians(TURN * (centres[:, 0] - chord)))


def place_levels(spine: PatientSpine, body: np.ndarray, scale: float) -> PlacedSpine:
    """The vertebrae where the middles of all or of the lower ones are known; those above go on as in the body.

    Args:
        spine: with levels, in the frame of the pelvis.
        body: middles of T1 to L5 of the straight body, shape (17, 3) [mm].
        scale: of the patient over the body.
    """
    from scipy.interpolate import make_smoothing_spline  # heavy

    above = len(VERTEBRAE) - len(spine.levels)
    offset = scale * (body[:above] - body[above])
    known = spine.line
    lean = (known[0] - known[2]) / np.linalg.norm(known[0] - known[2])
    own = (body[above] - body[above + 2]) / np.linalg.norm(body[above] - body[above + 2])
    centres = np.vstack([known[0] + offset + np.linalg.norm(offset, axis=1)[:, None] * (lean - own), known])
    down = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(centres, axis=0), axis=1))])
    up = -np.column_stack([make_smoothing_spline(down, t, lam=_SMOOTH).derivative()(down) for t in centres.T])
    if spine.up is not None:
        up[above:] = spine.up
    up /= np.linalg.norm(up, axis=1)[:, None]
    assert spine.across is not None
    turn = np.arctan2(spine.across[:, 1], spine.across[:, 0])
    if spine.kind == "pedicles":
        turn = make_smoothing_spline(down[above:], turn, lam=_SMOOTH)(down[above:])
    fade = np.arange(1, above + 1) / (above + 1)
    return PlacedSpine(centres, up, np.concatenate([turn[0] * fade, turn]))


def poses_of(placed: PlacedSpine, centres: np.ndarray, axes: np.ndarray) -> dict[str, VertebraPose]:
    """The motion of each vertebra of a straight body, whose middles and axes are (17, 3), to its place."""
    found = {}
    for row, level in enumerate(VERTEBRAE):
        (x, y, z), own = placed.up[row], axes[row] * [0.0, 1.0, 1.0]
        tilt = float(np.arctan2(x, z))
        pitch = float(np.arctan2(-y, np.hypot(x, z)) - np.arctan2(-own[1], own[2]))
        before, after = centres[row], placed.centres[row]
        axis = own / np.linalg.norm(own)
        found[level] = VertebraPose(tilt, pitch, float(placed.turn[row]), axis, before, after)
    return found
