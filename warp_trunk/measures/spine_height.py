"""How tall the spine stands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .spine import Spine


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
