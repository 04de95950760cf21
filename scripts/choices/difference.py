"""How far two predicted skins are apart where a surgeon looks: on the back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warp_trunk import Landmarks, Surface, back_surface_rotation
from warp_trunk.measures.regions import regions_of


@dataclass(frozen=True)
class Difference:
    """Of one skin from another with the same vertices."""

    mean_mm: float
    """Mean distance between the places of a point of the back, weighted by area [mm]."""
    max_mm: float
    """Largest such distance [mm]."""
    bsr_deg: float
    """Largest difference of the back surface rotation of a level [degrees]."""
    level: str
    """The level of that difference."""


def difference(skin: Surface, other: Surface, landmarks: Landmarks, found: Landmarks | None = None) -> Difference:
    """The distance of a skin from another.

    The back is the region of that name in `compare_skins`: what faces back between T1 and L5. Levels are T1 to L5.

    Args:
        skin: one skin [mm].
        other: the other, which says where the back is; same vertices and faces.
        landmarks: those after surgery [mm].
        found: landmarks with errors [mm], by which the rotation of the first skin is measured instead.
    """
    regions = regions_of(other, landmarks)
    back = regions.masks["back"]
    distance = np.linalg.norm(skin.vertices - other.vertices, axis=1)[back]
    theirs = back_surface_rotation(other, landmarks)
    turned = {
        level: abs(tangent.angle - same.angle)
        for level, tangent in back_surface_rotation(skin, found or landmarks).items()
        if level[0] in "TL" and tangent is not None and (same := theirs[level]) is not None
    }
    level = max(turned, key=lambda name: turned[name])
    return Difference(
        mean_mm=float(np.average(distance, weights=regions.area[back])),
        max_mm=float(distance.max()),
        bsr_deg=turned[level],
        level=level,
    )
