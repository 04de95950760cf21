"""The spine from the side: kyphosis, lordosis and its height."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .spine import Spine

if TYPE_CHECKING:
    from .spine import Spine

KYPHOSIS = {"T1-T12": ("T1", "T12"), "T5-T12": ("T5", "T12")}
LORDOSIS = {"L1-L5": ("L1", "L5"), "L1-S1": ("L1", "S1")}
"""Upper and lower vertebra of each angle, by its name."""


def kyphosis(spine: Spine) -> dict[str, float | None]:
    """How far the thoracic spine bends forward, between the axes of two vertebrae [degrees], by `KYPHOSIS`.

    The sagittal Cobb angle of T5 to T12, as the Lenke classification grades it (J Bone Joint Surg Am 2001,
    83:1169), and of T1 to T12; here between the axes of the vertebrae, endplate centre to endplate centre, as
    `cobb_angles` has it. Lines along the outer endplates, as on a film, give half the wedging of the two more.

    Args:
        spine: vertebrae with their endplates [mm].

    Returns:
        By name, positive where the back is round; None where an endplate has no landmark.
    """
    return {name: sagittal_angle(spine, upper, lower) for name, (upper, lower) in KYPHOSIS.items()}


def lordosis(spine: Spine) -> dict[str, float | None]:
    """How far the lumbar spine bends backward, between the axes of two vertebrae [degrees], by `LORDOSIS`.

    Measured as `kyphosis` is, positive where the small of the back is hollow. On films lumbar lordosis is that
    of L1 to S1 (Stagnara et al., Spine 1982, 7:335); the axis of S1 is known only where the sacrum has
    landmarks at the centres of both endplates of S1.
    """
    angles = {name: sagittal_angle(spine, upper, lower) for name, (upper, lower) in LORDOSIS.items()}
    return {name: None if angle is None else -angle for name, angle in angles.items()}


def sagittal_angle(spine: Spine, upper: str, lower: str) -> float | None:
    """How much further back the axis of the lower vertebra leans than that of the upper one, from the side.

    Args:
        spine: vertebrae with their endplates [mm].
        upper: name of a vertebra.
        lower: name of one below it; S1 is that of the sacrum.

    Returns:
        Degrees, positive for a kyphosis, negative for a lordosis; None where an endplate has no landmark.
    """
    tilt = [sagittal_tilt(spine.endplates_of(level)) for level in (upper, lower)]
    angle = float(tilt[1] - tilt[0])
    return angle if np.isfinite(angle) else None


def sagittal_tilt(endplates: np.ndarray) -> np.ndarray:
    """Tilt of each vertebra's axis seen from the side [degrees], positive where it leans back, shape (...).

    endplates: superior and inferior endplate centres [mm], shape (..., 2, 3).
    """
    axis = endplates[..., 0, :] - endplates[..., 1, :]
    return np.degrees(np.arctan2(axis[..., 1], axis[..., 2]))


@dataclass(frozen=True)
class SpineHeight:
    """Height of the spine: what an operation that straightens it adds to the patient's own."""

    height: float
    """From the lower end to the upper one along the vertical [mm]."""
    upper: str
    """The vertebra whose upper endplate is the upper end."""
    lower: str
    """The lower end: S1 for its upper endplate, or L5 for its lower one."""


def spine_height(spine: Spine) -> SpineHeight | None:
    """Vertical distance between the centres of the upper endplates of T1 and S1.

    Spinal height T1-S1 of the Radiographic Measurement Manual (O'Brien et al. 2008). Where the sacrum
    has no landmarks the lower endplate of L5 stands in for that of S1, without the disc between them.

    Args:
        spine: vertebrae with their endplates [mm].

    Returns:
        None where T1, or both S1 and L5, have no landmark there.
    """
    top = spine.endplates_of("T1")[0, 2]
    for lower, end in (("S1", 0), ("L5", 1)):
        height = float(top - spine.endplates_of(lower)[end, 2])
        if np.isfinite(height):
            return SpineHeight(height, "T1", lower)
    return None
