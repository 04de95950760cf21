"""The markers on a back: the iliac spines, which are its frame, and where the spine begins and ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError

FOOT = {"asis": 0.065, "psis": 0.06}
"""Height of the spinous process of L5 above the iliac spines over that of C7: ASIS in seven bodies, PSIS in 20
patients (0.03 to 0.10)."""


@dataclass(frozen=True, eq=False)
class BackMarkers:
    """The markers of a back."""

    pair: str
    """asis or psis: the iliac spines against which rotations are measured."""
    left: np.ndarray
    """The left one [mm], shape (3,)."""
    right: np.ndarray
    """The right one [mm], shape (3,)."""
    c7: np.ndarray
    """The spinous process of C7 [mm], shape (3,); NaN where only the pelvis is known."""
    foot: float
    """Height of the spinous process of L5 [mm]; NaN where only the pelvis is known."""

    @property
    def middle(self) -> np.ndarray:
        """Midway between the iliac spines [mm], shape (3,)."""
        return 0.5 * (self.left + self.right)

    @property
    def across(self) -> np.ndarray:
        """Unit vector from the right to the left one, seen from above, shape (2,)."""
        axis = (self.left - self.right)[:2]
        return axis / np.hypot(*axis)


def back_markers(*tables: Landmarks | None, what: str = "markers", spine: bool = True) -> BackMarkers:
    """The markers by their names, in small or large letters: C7, and ASIS_left and ASIS_right or those of PSIS.

    Where both pairs are given the anterior one counts, as rotations are measured against it. `lower` is the
    spinous process of L5, which lies `FOOT` above the iliac spines where it is not given.

    Args:
        tables: where the markers are.
        what: what to call them in an error.
        spine: whether C7 and L5 are needed.

    Raises:
        InputError: a marker is missing, left and right are exchanged, or C7 is not above the pelvis.
    """
    present = [table for table in tables if table is not None]
    marks = {name.lower(): table.point(name) for table in present for name in table.names}
    pair = next((stem for stem in FOOT if {f"{stem}_left", f"{stem}_right"} <= marks.keys()), None)
    if pair is None or (spine and "c7" not in marks):
        needed = f"{'C7, ' if spine else ''}PSIS_left and PSIS_right (or ASIS_left and ASIS_right)"
        names = ", ".join(name for table in present for name in table.names) or "none"
        raise InputError(f"{what}: needs {needed}, and has {names}; add what is missing")
    left, right = marks[f"{pair}_left"], marks[f"{pair}_right"]
    aside, least = left[0] - right[0], max(20.0, 0.5 * float(np.linalg.norm(left - right)))
    if not aside >= least:
        rule = f"{pair.upper()}_left must lie left (+x) of {pair.upper()}_right by {least:.0f} mm or more"
        cure = "exchange the names, or give mm and LPS axes"
        raise InputError(f"{what}: {rule}, and lies at {aside:.3g} mm; {cure}")
    if not spine:
        return BackMarkers(pair, left, right, np.full(3, np.nan), np.nan)
    top, pelvis = marks["c7"][2], 0.5 * (left + right)[2]
    foot = marks["lower"][2] if "lower" in marks else pelvis + FOOT[pair] * (top - pelvis)
    if not 150.0 <= top - foot <= 750.0:
        cure = "give mm and LPS axes, +z up"
        raise InputError(f"{what}: C7 must be 150 to 750 mm above L5, and is {top - foot:.4g} mm; {cure}")
    return BackMarkers(pair, left, right, marks["c7"], float(foot))
