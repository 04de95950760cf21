"""The horizontal section of the trunk at each vertebra."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.geometry.section import sections, trunk_loop

from .spine import Spine

if TYPE_CHECKING:
    from warp_trunk.geometry.surface import Surface


def outlines_of(surface: Surface, spine: Spine) -> tuple[dict[str, np.ndarray | None], dict[str, str]]:
    """Outline of the trunk at the height of each vertebra's centroid; of several loops the one around it.

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
        outlines[level] = outline = trunk_loop(loops, centroid[:2])
        if not loops:
            missing[level] = f"the plane at z = {centroid[2]:.0f} mm misses the skin"
        elif outline is None:
            missing[level] = f"no part of the section at z = {centroid[2]:.0f} mm goes round the vertebra"
    return outlines, missing
