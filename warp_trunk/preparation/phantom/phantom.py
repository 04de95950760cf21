"""A synthetic trunk, straight or scoliotic, that needs no file: the case of `warp-trunk demo`."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta

from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.checking import checked
from warp_trunk.geometry.surface import Surface

from ..deformity import SpineCurve
from ..deformity.deformity import imposed_case
from .bones import skeleton
from .skin import trunk_skin

SIZE = np.array([326.0, 225.0, 575.0])
"""Width, depth and height of the skin of an adolescent girl without a deformity [mm]."""


def straight_trunk() -> tuple[Surface, dict[str, Surface], Landmarks]:
    """Skin, bones and landmarks of a healthy trunk, its own mirror image in x = 0.

    Returns:
        The skin (lowest at z = 0); bones T1 to L5, rib_left_01 to rib_right_12, sternum, sacrum, hip_left and
        hip_right; and six landmarks for each vertebra, asis_left and asis_right, all of them vertices of
        their bone.
    """
    skin = trunk_skin()
    bones, landmarks = skeleton()
    stretch = SIZE / np.ptp(skin.vertices, axis=0)
    stretched = {name: Surface(bone.vertices * stretch, bone.faces) for name, bone in bones.items()}
    marks = Landmarks(landmarks.names, landmarks.points * stretch)
    return Surface(skin.vertices * stretch, skin.faces), stretched, marks


@checked
def phantom_case(
    curve: SpineCurve | None = None, correction: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.7
) -> Case:
    """The phantom with a scoliosis, and the correction of a fraction of it.

    >>> wt.phantom_case().name
    'synthetic trunk, thoracic curve of 55 degrees, 70 % corrected'

    Args:
        curve: the scoliosis; thoracic with a Cobb angle of 55 degrees when left out.
        correction: fraction of Cobb angle and axial rotation that surgery takes away, 0 to 1.

    Raises:
        InputError: a fraction outside [0, 1], or a curve so strong that it would fold the trunk (see `impose`).
    """
    curve = curve or SpineCurve(cobb=55.0)
    name = f"synthetic trunk, {curve.kind} curve of {curve.cobb:g} degrees, {100 * correction:g} % corrected"
    return imposed_case(*straight_trunk(), curve, correction, name)
