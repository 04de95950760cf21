"""Every curve of the spine followed from before surgery to the plan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from warp_trunk.measures import ApicalVertebra, CobbAngle, curves_after
from warp_trunk.measures.apical import apical_vertebrae
from warp_trunk.measures.spine import spine_of

if TYPE_CHECKING:
    from .style import Pose

MAIN = 0.8
"""A curve at least this part of the largest is a main curve too: a double major has two."""


@dataclass(frozen=True)
class CurveChange:
    """One curve before surgery and what the plan makes of it, told of the same vertebrae."""

    before: CobbAngle
    """As it is."""
    angle_after: float
    """Its Cobb angle as planned [degrees], negative beyond straight."""
    apex_before: ApicalVertebra
    """Its apical vertebra as it is."""
    apex_after: ApicalVertebra
    """The same vertebra as planned."""

    @property
    def ends(self) -> str:
        """Its end vertebrae."""
        return f"{self.before.upper} to {self.before.lower}"


def curve_changes(before: Pose, planned: Pose) -> tuple[CurveChange, ...]:
    """Every curve of the spine before surgery, top to bottom, each followed between the same two vertebrae."""
    curves, after = before.measures.cobb, planned.measures
    if after.sacral_line is None:
        return ()
    apices = apical_vertebrae(spine_of(planned.landmarks), curves, after.axial_rotation, after.sacral_line)
    angles = curves_after(curves, planned.landmarks)
    rows = zip(curves, angles, before.measures.apices, apices, strict=True)
    return tuple(CurveChange(curve, angle, was, will) for curve, angle, was, will in rows if angle is not None)


def main_curves(curves: tuple[CurveChange, ...]) -> tuple[CurveChange, ...]:
    """Those that a spine is named after, top to bottom."""
    largest = max((curve.before.angle for curve in curves), default=0.0)
    return tuple(curve for curve in curves if curve.before.angle >= MAIN * largest)
