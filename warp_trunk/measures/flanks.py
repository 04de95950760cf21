"""Asymmetry of the flanks: how wide the trunk is on either side of the sacrum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .trunk_shift import SacralLine


@dataclass(frozen=True)
class FlankAsymmetry:
    """Widths of one level of the trunk, along the pelvis' axis."""

    left: float
    """From the sacral line to the left flank [mm]."""
    right: float
    """From the sacral line to the right flank [mm]."""

    @property
    def index(self) -> float:
        """Difference of the widths in percent of the whole, positive where the right one is wider."""
        return 100.0 * (self.right - self.left) / (self.right + self.left)


def flank_asymmetry(outline: np.ndarray, line: SacralLine) -> FlankAsymmetry:
    """How far the two flanks of a level are from the central sacral vertical line.

    The frontal asymmetry index of POTSI, the posterior trunk symmetry index (Suzuki et al., Stud Health Technol
    Inform 1999, 59:81), which takes it at the armpits and the waist; here it is known at every level and keeps
    its sign. Where the arms of a skin are cut off, the cut is its flank.

    Args:
        outline: section of the trunk, x and y [mm], shape (points, 2).
        line: see `sacral_line`.
    """
    to_left = (outline - line.point) @ line.across
    return FlankAsymmetry(left=float(to_left.max()), right=-float(to_left.min()))
