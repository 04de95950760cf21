"""A synthetic trunk, straight or scoliotic, that needs no file: the case of `warp-trunk demo`."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from .errors import InputError
from .landmarks import Landmarks
from .phantom_bones import skeleton
from .phantom_skin import trunk_skin
from .surface import Surface

SIZE_RANGES = {"height": (400.0, 600.0), "width": (250.0, 380.0), "depth": (160.0, 240.0)}
"""What each size may be [mm]; the shape is tested at the ends of these ranges."""


@dataclass(frozen=True, kw_only=True)
class TrunkSize:
    """Outer size of the phantom's skin before a deformity; by default that of an adolescent."""

    height: float = 480.0
    """From the hips to the neck [mm], 400 to 600."""
    width: float = 300.0
    """From side to side [mm], 250 to 380."""
    depth: float = 190.0
    """From front to back [mm], 160 to 240."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value, (low, high) = getattr(self, field.name), SIZE_RANGES[field.name]
            if not low <= value <= high:
                raise InputError(f"phantom: '{field.name}' must be {low:g} to {high:g} mm, not {value}")


def straight_trunk(size: TrunkSize | None = None) -> tuple[Surface, dict[str, Surface], Landmarks]:
    """Skin, bones and landmarks of a healthy trunk, its own mirror image in x = 0.

    The shape is drawn once. Another size is its image under a stretch along x, y and z, which keeps it closed
    and free of self-intersections.

    Returns:
        The skin (lowest at z = 0); bones T1 to L5, rib_left_01 to rib_right_12, sternum, sacrum, hip_left and
        hip_right; and six landmarks for each vertebra, asis_left and asis_right, all of them vertices of
        their bone.
    """
    size = size or TrunkSize()
    skin = trunk_skin()
    bones, landmarks = skeleton()
    stretch = np.array([size.width, size.depth, size.height]) / np.ptp(skin.vertices, axis=0)

    def stretched(surface: Surface) -> Surface:
        return Surface(surface.vertices * stretch, surface.faces)

    return (
        stretched(skin),
        {name: stretched(bone) for name, bone in bones.items()},
        Landmarks(landmarks.names, landmarks.points * stretch),
    )
