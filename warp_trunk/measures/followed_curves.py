"""Each curve of a spine before surgery, followed between the same vertebrae in the spine after it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .apical import ApicalVertebra, apical_vertebrae
from .cobb import CobbAngle, angles_between

if TYPE_CHECKING:
    from .measures import TrunkMeasures

MAIN = 0.8
"""A curve of at least this part of the largest is a main curve too: a double major has two."""


@dataclass(frozen=True)
class FollowedCurve:
    """One curve before surgery, and the same vertebrae after it."""

    before: CobbAngle
    """The curve before surgery."""
    angle_after: float | None
    """Its Cobb angle after surgery [degrees], negative beyond straight; None where an endplate is missing."""
    apex_before: ApicalVertebra
    """Its apical vertebra before surgery."""
    apex_after: ApicalVertebra
    """The same vertebra after surgery."""

    @property
    def ends(self) -> str:
        """Its end vertebrae."""
        return f"{self.before.upper} to {self.before.lower}"


def followed_curves(before: TrunkMeasures, after: TrunkMeasures) -> tuple[FollowedCurve, ...]:
    """Every curve of the spine before surgery, top to bottom."""
    if after.sacral_line is None:
        return ()
    angles = angles_between(before.cobb, after.spine)
    apices = apical_vertebrae(after.spine, before.cobb, after.axial_rotation, after.sacral_line)
    return tuple(FollowedCurve(*each) for each in zip(before.cobb, angles, before.apices, apices, strict=True))


def main_curves(curves: Sequence[FollowedCurve]) -> tuple[FollowedCurve, ...]:
    """The curves that a spine is named after, top to bottom."""
    largest = max((curve.before.angle for curve in curves), default=0.0)
    return tuple(curve for curve in curves if curve.before.angle >= MAIN * largest)
