"""The regions of a trunk that surgeons distinguish, for each vertex of a skin."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.case.anatomy import LUMBAR, THORACIC
from warp_trunk.errors import InputError
from warp_trunk.geometry.normals import corner_areas, vertex_normals

from .spine import asis_axis, spine_of

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.geometry.surface import Surface

BANDS = {
    "upper thoracic": THORACIC[:4],
    "main thoracic": THORACIC[4:],
    "lumbar": LUMBAR,
}
"""Vertebral levels by the region of the spine that surgeons name a curve after."""
_SIDEWAYS = math.cos(math.radians(30.0))
"""Skin that faces within 30 degrees of sideways is flank; of up or down, it is no region's."""


@dataclass(frozen=True, eq=False)
class Regions:
    """Where the vertices of a skin lie, and how much of it each stands for."""

    band: np.ndarray
    """Number of the band in `BANDS` by the nearest vertebra, -1 above T1, below L5 or facing up or down; (n,)."""
    to_left: np.ndarray
    """True left of the spine, as it runs at that height, shape (n,)."""
    facing: np.ndarray
    """1 where the skin faces back, -1 front, 0 sideways, shape (n,)."""
    normals: np.ndarray
    """Unit normals, outward, shape (n, 3)."""
    area: np.ndarray
    """Area of the skin around each vertex [mm2], shape (n,)."""

    @cached_property
    def masks(self) -> dict[str, np.ndarray]:
        """The vertices of each region by name, (n,) bool: back, front and flanks, then the parts of each band."""
        inside = self.band >= 0
        back, flank = self.facing == 1, self.facing == 0
        found = {"back": inside & back, "front": inside & (self.facing == -1), "flanks": inside & flank}
        for number, band in enumerate(BANDS):
            for part, faces in (("back", back), ("flank", flank)):
                for side, where in (("left", self.to_left), ("right", ~self.to_left)):
                    found[f"{band}, {part} {side}"] = (self.band == number) & faces & where
        return found


def regions_of(skin: Surface, landmarks: Landmarks) -> Regions:
    """Sort the vertices of a skin into regions.

    Skin is back or front by where its normal points in the axes of the pelvis, and flank within 30 degrees of
    sideways: there the arms are cut off, so that flanks may hold a cut plane and back and front never do. Skin
    that faces within 30 degrees of up or down (shoulders, the cuts through neck and thighs) is in no region.

    Args:
        skin: the surface [mm], oriented outward.
        landmarks: those of the spine and the pelvis that go with it [mm].

    Raises:
        InputError: no ASIS, or no vertebra, among the landmarks.
    """
    across, spine = asis_axis(landmarks), spine_of(landmarks)
    behind = np.array([-across[1], across[0]])
    known = [i for i, level in enumerate(spine.levels) if any(level in levels for levels in BANDS.values())]
    if not known:
        raise InputError(
            "landmarks: no vertebra from T1 to L5 has a landmark; regions are assigned by the nearest one"
        )
    centroids = spine.centroids[known]
    level = _nearest_level(skin.vertices[:, 2], centroids[:, 2])
    number = {name: i for i, names in enumerate(BANDS.values()) for name in names}
    bands = np.array([*(number[spine.levels[i]] for i in known), -1])
    normals = vertex_normals(skin)
    upward = np.argsort(centroids[:, 2])
    heights, line = centroids[upward, 2], centroids[upward, :2]
    middle = np.column_stack([np.interp(skin.vertices[:, 2], heights, line[:, axis]) for axis in (0, 1)])
    level_side = normals[:, :2] / np.maximum(np.linalg.norm(normals[:, :2], axis=1), 1e-12)[:, None]
    facing = np.where(np.abs(level_side @ across) > _SIDEWAYS, 0, np.sign(level_side @ behind))
    return Regions(
        band=np.where(np.abs(normals[:, 2]) > _SIDEWAYS, -1, bands[level]),
        to_left=((skin.vertices[:, :2] - middle) @ across) > 0.0,
        facing=facing.astype(np.int8),
        normals=normals,
        area=corner_areas(skin),
    )


def _nearest_level(height: np.ndarray, centroids: np.ndarray) -> np.ndarray:
    """Which centroid is nearest in height; -1 more than half a vertebra above the top or below the bottom."""
    order = np.argsort(centroids)
    sorted_heights = centroids[order]
    nearest = order[np.searchsorted((sorted_heights[1:] + sorted_heights[:-1]) / 2.0, height)]
    half = np.diff(sorted_heights)[[0, -1]] / 2.0 if len(centroids) > 1 else np.full(2, 15.0)
    outside = (height < sorted_heights[0] - half[0]) | (height > sorted_heights[-1] + half[1])
    return np.where(outside, -1, nearest)
