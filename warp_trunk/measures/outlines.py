"""The sections of the trunk, and the widths of its flanks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.geometry.section import SHOULDERS, own_part, sections, trunk_loop

from .spine import Spine
from .trunk_shift import SacralLine

if TYPE_CHECKING:
    from warp_trunk.geometry.surface import Surface


def outlines_of(surface: Surface, spine: Spine) -> tuple[dict[str, np.ndarray | None], dict[str, str]]:
    """Outline of the trunk at the height of each vertebra's centroid; of several loops the one around it,
    and where arms touch the trunk (`own_part`) without them.

    Args:
        surface: the skin [mm], closed.
        spine: vertebrae [mm].

    Returns:
        By level, top to bottom: x and y [mm], shape (points, 2), counterclockwise seen from above, or None where
        it is missing; and why, for those.

    Raises:
        InputError: the surface is open where it is cut.
    """
    outlines: dict[str, np.ndarray | None] = {}
    missing: dict[str, str] = {}
    cuts = sections(surface, spine.centroids[:, 2].tolist())
    for level, centroid, loops in zip(spine.levels, spine.centroids, cuts, strict=True):
        outline = trunk_loop(loops, centroid[:2])
        own = None if outline is None or level in SHOULDERS else own_part(outline, centroid[:2])
        outlines[level] = outline = outline if own is None else own
        if not loops:
            missing[level] = f"the plane at z = {centroid[2]:.0f} mm misses the skin"
        elif outline is None:
            missing[level] = f"no part of the section at z = {centroid[2]:.0f} mm goes round the vertebra"
    return outlines, missing


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
