"""What a trunk looks like in the numbers a clinic uses."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from .back_rotation import DualTangent, back_surface_rotation
from .cobb import CobbAngle, cobb_angles

if TYPE_CHECKING:
    from ..landmarks import Landmarks
    from ..surface import Surface


@dataclass(frozen=True)
class TrunkMeasures:
    """Measures of one skin with the spine that goes with it."""

    tangents: dict[str, DualTangent | None]
    """Section and dual tangent by vertebral level, top to bottom; None where the plane misses the trunk."""
    cobb: tuple[CobbAngle, ...]
    """Curves of the spine, top to bottom."""
    skin_change_max: float | None
    """Largest displacement of a skin vertex from the skin compared with [mm]; None if there was none."""
    skin_change_mean: float | None
    """Mean of the same over the vertices [mm]."""

    @property
    def bsr(self) -> dict[str, float | None]:
        """Back surface rotation [degrees] by level, positive for a hump on the right; None where missing."""
        return {level: None if t is None else t.angle for level, t in self.tangents.items()}

    @property
    def max_thoracic_bsr(self) -> float | None:
        """The rotation of largest size from T1 to T12, with its sign [degrees]; None if all are missing."""
        return self._largest("T")

    @property
    def max_lumbar_bsr(self) -> float | None:
        """The rotation of largest size from L1 to L5, with its sign [degrees]; None if all are missing."""
        return self._largest("L")

    @property
    def worst_level(self) -> str | None:
        """The level of the rotation of largest size; None if all are missing."""
        known = {level: abs(angle) for level, angle in self.bsr.items() if angle is not None}
        return max(known, key=known.__getitem__, default=None)

    def _largest(self, region: str) -> float | None:
        angles = [a for level, a in self.bsr.items() if a is not None and re.match(rf"{region}\d", level)]
        return max(angles, key=abs, default=None)


def measure(skin: Surface, landmarks: Landmarks, before: Surface | None = None) -> TrunkMeasures:
    """Measure a skin: back surface rotation at each level, the Cobb angles of its spine, its change.

    Args:
        skin: the surface to measure, predicted, scanned or before surgery [mm].
        landmarks: those that go with this skin: before surgery for the skin before, after for the others.
        before: the same skin before surgery, with the same vertices in the same order.

    Raises:
        InputError: no ASIS among the landmarks, or `before` with another number of vertices.
    """
    change = None
    if before is not None:
        if before.vertices.shape != skin.vertices.shape:
            raise InputError(
                f"before: has {len(before.vertices)} vertices and the skin {len(skin.vertices)}; "
                "the change of a skin is measured between the same vertices"
            )
        change = np.linalg.norm(skin.vertices - before.vertices, axis=1)
    return TrunkMeasures(
        tangents=back_surface_rotation(skin, landmarks),
        cobb=cobb_angles(landmarks),
        skin_change_max=None if change is None else float(change.max()),
        skin_change_mean=None if change is None else float(change.mean()),
    )
