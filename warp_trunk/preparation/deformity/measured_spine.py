"""A spine that was measured, as from a CT, imposed on straight anatomy."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.case.landmarks import VERTEBRAE, read_landmarks
from warp_trunk.errors import InputError

from .published_curves import LUMBOSACRAL
from .spine_curve import LEVELS, SpineAngles, left_after

if TYPE_CHECKING:
    from warp_trunk.measures.spine import Spine

FEWEST = 8
"""Levels in a row down to L5 that a measured spine needs."""
_POINTS = ("body", "left_pedicle", "right_pedicle")


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredSpine:
    """The shape of a real spine; sizes are those of the anatomy on which it is imposed."""

    name: str
    """Its name."""
    tilt: np.ndarray
    """Coronal tilt of the centre line at T1 to L5, positive towards +x going up [rad], shape (17,)."""
    pitch: np.ndarray
    """Sagittal tilt of the centre line, positive forward going up [rad], shape (17,); NaN where it is unknown."""
    turn: np.ndarray
    """Axial rotation, positive from +x to +y [rad], shape (17,)."""
    continued: tuple[str, ...] = ()
    """Levels that were not measured; the curve fades out over them."""

    def __str__(self) -> str:
        return f"spine {self.name}"

    @property
    def shoulders(self) -> float:
        """How much higher the right shoulder stands [mm]: nothing is known of it, so it stays as it was."""
        return 0.0

    def corrected(self, fraction: float) -> MeasuredSpine:
        """The spine after a fraction in [0, 1] of tilt and axial rotation is corrected; the profile stays.

        Raises:
            InputError: a fraction outside [0, 1].
        """
        left = left_after(fraction)
        return replace(self, tilt=left * self.tilt, turn=left * self.turn)

    def angles(self, straight: Spine) -> SpineAngles:
        """The turns of each vertebra from the straight spine."""
        centres = straight.centroids[[straight.levels.index(level) for level in VERTEBRAE]]
        own = np.arctan2(*(np.gradient(centres[:, axis]) * sign for axis, sign in ((1, 1.0), (2, -1.0))))
        known = ~np.isnan(self.pitch)
        pitch = np.where(known, self.pitch - own, 0.0)
        first = int(known.argmax())
        pitch[:first] = pitch[first]
        pitch -= pitch[-1]  # the sacrum stays, and how a spine leans as a whole is not known of a scan taken lying
        return SpineAngles(tilt=self.tilt, pitch=pitch, turn=self.turn)


def read_measured_spine(path: str | Path) -> MeasuredSpine:
    """Read `name,x,y,z` in mm and LPS: `T4_body`, `T4_left_pedicle`, `T4_right_pedicle` and so on down to L5.

    Each track is smoothed along the spine, since single key points are off by millimetres. Rotation is taken
    against the mean of both ends: there is no pelvis in the file. The curve fades out over levels above the
    highest one.

    Raises:
        InputError: a file that cannot be read, a row that is no point, a level without all three points, or fewer
            than 8 levels in a row down to L5.
    """
    path = Path(path)
    marks = read_landmarks(path)
    levels = [level for level in VERTEBRAE if f"{level}_body" in marks.names]
    if levels != list(VERTEBRAE[LEVELS - len(levels) :]) or len(levels) < FEWEST:
        found = ", ".join(levels) or "none"
        raise InputError(
            f"{path}: needs {FEWEST} or more levels in a row down to L5, has {found}; give their points"
        )
    names = [[f"{level}_{part}" for level in levels] for part in _POINTS]
    for name in (name for part in names for name in part if name not in marks.names):
        raise InputError(f"{path}: '{name}' is missing; each level needs {', '.join(_POINTS)}")
    body, left, right = (np.array([marks.point(name) for name in part]) for part in names)
    if not (np.diff(body[:, 2]) < 0.0).all():
        raise InputError(f"{path}: body centres must lie one above the other, T1 highest; give them in mm and LPS")

    from scipy.interpolate import make_smoothing_spline

    down = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(body, axis=0), axis=1))])
    line = [make_smoothing_spline(down, track, lam=_SMOOTH).derivative()(down) for track in body.T]
    x, y, z = (-track for track in line)  # going up
    tilt, pitch = np.arctan2(x, z), np.arctan2(-y, np.hypot(x, z))
    across = left - right
    turn = np.arctan2(across[:, 1], across[:, 0])
    turn = make_smoothing_spline(down, turn, lam=_SMOOTH)(down)
    turn -= 0.5 * (turn[0] + turn[-1])
    above = LEVELS - len(levels)
    fade = np.arange(1, above + 1) / (above + 1)
    tilt[-1] *= LUMBOSACRAL
    return MeasuredSpine(
        name=path.stem,
        tilt=np.concatenate([tilt[0] * fade, tilt]),
        pitch=np.concatenate([np.full(above, math.nan), pitch]),
        turn=np.concatenate([turn[0] * fade, turn]),
        continued=VERTEBRAE[:above],
    )


_SMOOTH = 3000.0
"""Weight of the integrated squared curvature in the smoothing of a track [mm^3]: of errors that alternate from
level to level it leaves a tenth, of a curve over seven levels 97 %."""
