"""A case: what the clinic gives."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from ..landmarks import Landmarks
from ..surface import Surface
from ..tissue import Tissue


@dataclass(frozen=True, eq=False)
class Case:
    """A patient and a planned correction, in LPS axes and mm."""

    name: str
    """What to call the case in results."""
    skin: Surface
    """The trunk before surgery: closed, in one piece, outward winding."""
    bones: dict[str, Surface]
    """The bones before surgery by name (`T7`, `rib_left_01`, `hip_left`); they may overlap."""
    landmarks_before: Landmarks
    """Points on the bones before surgery."""
    landmarks_after: Landmarks
    """The same points after surgery, same names in the same order."""
    skin_after: Surface | None = None
    """The trunk after surgery where known; it need not have the triangles of `skin`."""
    skin_after_is_placeholder: bool = False
    """True when skin_after is the spline's own image of the skin, which is no truth to compare with."""
    tissue: Tissue = dataclasses.field(default_factory=Tissue)
    """Constants of the soft tissue."""
