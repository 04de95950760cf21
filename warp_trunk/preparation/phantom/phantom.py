"""A synthetic trunk, straight or scoliotic, that needs no file: the case of `warp-trunk demo`."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import crossings

from ..deformity import SpineCurve, correct, impose
from .bones import skeleton
from .skin import trunk_skin

_MARGIN = 4.0  # least depth of a bone under the skin [mm]

SIZE_RANGES = {"height": (400.0, 600.0), "width": (250.0, 380.0), "depth": (160.0, 240.0)}
"""Range of each size [mm]; the shape is tested at the ends of these ranges."""


@dataclass(frozen=True, kw_only=True)
class TrunkSize:
    """Outer size of the skin without a deformity; by default that of an adolescent girl."""

    height: float = 575.0
    """From the hips to the neck [mm], 400 to 600."""
    width: float = 326.0
    """From side to side [mm], 250 to 380."""
    depth: float = 225.0
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


def phantom_case(size: TrunkSize | None = None, curve: SpineCurve | None = None, correction: float = 0.7) -> Case:
    """The phantom with a scoliosis, and the correction of a fraction of it.

    >>> wt.phantom_case().name
    'synthetic trunk, thoracic curve of 55 degrees, 70 % corrected'

    Args:
        size: of the trunk while it is straight; an adolescent's when left out.
        curve: the scoliosis; thoracic with a Cobb angle of 55 degrees when left out.
        correction: fraction of Cobb angle and axial rotation that surgery takes away, 0 to 1.

    Raises:
        InputError: a fraction outside [0, 1], or a curve too strong for this size: it would fold the trunk
            (see `impose`), make a surface cross itself, or bring a bone nearer than 4 mm to the skin. Of 60
            random sizes none was refused with a Cobb angle of 60 to 75 degrees and its default rotation.
    """
    curve = curve or SpineCurve(cobb=55.0)
    skin, bones, straight = straight_trunk(size)
    after = correct(straight, curve, correction)
    skin, bones, before = impose(skin, bones, straight, curve)
    _check(skin, bones, f"a {curve.kind} curve of {curve.cobb:g} degrees")
    return Case(
        name=f"synthetic trunk, {curve.kind} curve of {curve.cobb:g} degrees, {100 * correction:g} % corrected",
        skin=skin,
        bones=bones,
        landmarks_before=before,
        landmarks_after=after,
    )


def _check(skin: Surface, bones: dict[str, Surface], what: str) -> None:
    """Check what no formula promises of a deformed shape: that no surface crosses itself or the skin."""
    distance = SurfaceDistance(skin)
    for name, surface in [("the skin", skin), *bones.items()]:
        if len(crossings(surface)):
            raise InputError(f"phantom: {what} makes {name} cross itself at this size; ask for a smaller curve")
    for name, bone in bones.items():
        margin = -float(distance.at(bone.vertices).max())
        if margin < _MARGIN:
            raise InputError(
                f"phantom: {what} brings {name} to {margin:.1f} mm under the skin at this size, where "
                f"{_MARGIN:g} mm must be left; ask for a smaller curve"
            )
