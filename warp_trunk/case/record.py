"""A case: what the clinic gives."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from warp_trunk.engine.tissue import Tissue
from warp_trunk.geometry.surface import Surface

from .landmarks import Landmarks
from .layers import Layers


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
    actual_skin: Surface | None = None
    """The trunk after surgery where known; it need not have the triangles of `skin`."""
    tissue: Tissue = dataclasses.field(default_factory=Tissue)
    """Constants of the soft tissue."""
    bones_after: dict[str, Surface] = dataclasses.field(default_factory=dict)
    """Bones known after surgery, by name; each has the vertices of the one before, moved rigidly."""
    layers: Layers | None = None
    """Skin, fat and muscle, where the case says something of them."""

    def landmarks_at(self, load_factor: float) -> Landmarks:
        """The landmarks at a part of the correction in [0, 1]; each moves straight."""
        if load_factor == 1.0:
            return self.landmarks_after  # to the bit
        before, after = self.landmarks_before.points, self.landmarks_after.points
        return Landmarks(self.landmarks_before.names, before + load_factor * (after - before))
