"""A planned surgery: where the plan takes every vertebra, and what becomes of the spine."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

from warp_trunk.measures.sagittal import kyphosis, lordosis, spine_height
from warp_trunk.measures.spine import spine_of
from warp_trunk.measures.trunk_shift import sacral_line, trunk_shift

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.measures.cobb import CobbAngle

    from .record import Plan


@dataclass(frozen=True)
class VertebraMotion:
    """What a plan asks of one vertebra."""

    level: str
    """Its name."""
    fused: bool
    """Whether it is in the fusion."""
    shift: tuple[float, float, float]
    """How far its centroid goes to the left, to the back and up [mm]."""
    turn: tuple[float, float, float]
    """Change of its tilt to the left, its lean to the back, and its turn about its own axis, positive where the
    right side goes back [degrees]."""
    segment: tuple[float, float, float]
    """The same change less that of the vertebra below; of the lowest, less nothing [degrees]."""
    rotation: tuple[float, float]
    """Its axial rotation before and after, as `axial_rotation` measures it [degrees]."""


@dataclass(frozen=True)
class CurveMotion:
    """What becomes of one curve."""

    before: CobbAngle
    """The curve before surgery."""
    planned: bool
    """Whether the plan asks something of it."""
    cobb_after: float
    """Its Cobb angle after, between the same end vertebrae [degrees]; negative bends the other way."""
    rotation: tuple[float, float]
    """Axial rotation of its apex, before and after [degrees]."""
    flexibility: float | None
    """Share of its Cobb angle that bent out on a film of side bending; None without films."""


@dataclass(frozen=True, eq=False)
class PlannedSurgery:
    """The surgery that a plan asks for."""

    plan: Plan
    """The plan."""
    landmarks_before: Landmarks
    """Landmarks before surgery."""
    landmarks_after: Landmarks
    """The same after, same names in the same order."""
    vertebrae: tuple[VertebraMotion, ...]
    """Every vertebra, top to bottom."""
    curves: tuple[CurveMotion, ...]
    """Every curve of the spine before surgery, top to bottom."""
    warnings: tuple[str, ...]
    """What the surgeon should look at, in sentences."""

    @cached_property
    def measures(self) -> dict[str, tuple[float, float]]:
        """The whole spine before and after: angles from the side [degrees], plumb lines and height [mm]."""
        each = [_of_spine(marks) for marks in (self.landmarks_before, self.landmarks_after)]
        return {name: (before, each[1][name]) for name, before in each[0].items() if name in each[1]}

    @property
    def height_gained(self) -> float:
        """How much taller the spine stands, from the upper endplate of its highest vertebra [mm]."""
        name = f"{self.vertebrae[0].level}_superior_endplate"
        return float(self.landmarks_after.point(name)[2] - self.landmarks_before.point(name)[2])

    def planned_case(self, case: Case) -> Case:
        """The case with this surgery; what is known of another, actual one is left out."""
        return replace(case, landmarks_after=self.landmarks_after, actual_skin=None, bones_after={})


def _of_spine(marks: Landmarks) -> dict[str, float]:
    spine = spine_of(marks)
    height, shift = spine_height(spine), trunk_shift(spine, sacral_line(marks))
    found = {f"kyphosis {name}": angle for name, angle in kyphosis(spine).items()}
    found |= {f"lordosis {name}": angle for name, angle in lordosis(spine).items()}
    if shift is not None:
        found |= {"trunk shift to the right": shift.lateral, "trunk shift to the front": shift.forward}
    if height is not None:
        found["height of the spine"] = height.height
    return {name: value for name, value in found.items() if value is not None}
