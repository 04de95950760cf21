"""What is told of one plan for a virtual patient, simulated one way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warp_trunk import Landmarks, Surface, measure
from warp_trunk.measures.skin_quality import skin_change
from warp_trunk.measures.upper_back import rotation_along_shoulders

LEVELS = (*(f"T{number}" for number in range(1, 13)), "L1", "L2", "L3", "L4")
HUMP = slice(LEVELS.index("T5"), LEVELS.index("L3") + 1)
"""Where a hump is looked for: above T5 the section crosses the shoulders, below L3 the pelvis."""
FEW = 0.001
"""The part of the edges that may be worse than what is said of most."""


@dataclass(frozen=True)
class Smoothness:
    """How smooth a skin stays."""

    edges: tuple[float, float]
    """The least and the most of what triangles are stretched in their longest direction."""
    most_edges: tuple[float, float]
    """The same of all but the worst thousandth."""
    fold: float
    """By how much more any edge is folded [degrees]."""
    most_fold: float
    """The same of all but the worst thousandth."""

    @property
    def good(self) -> bool:
        """Whether it meets its bars."""
        return self.edges[0] >= 0.85 and self.edges[1] <= 1.2 and self.fold <= 10.0


def smoothness(before: Surface, after: Surface) -> Smoothness:
    """How smooth a skin stays against that before, of the same triangles."""
    change = skin_change(before, after)
    least, low, high, most = np.quantile(change.stretch, [0.0, FEW, 1.0 - FEW, 1.0]).tolist()
    return Smoothness(
        (least, most), (low, high), float(change.fold.max()), float(np.quantile(change.fold, 1.0 - FEW))
    )


@dataclass(frozen=True)
class Distance:
    """How far a skin lies from another one of the same triangles."""

    mean: float
    """Of all vertices [mm]."""
    most: float
    """Of all but a twentieth of them at most [mm]."""


def distance(skin: Surface, other: Surface) -> Distance:
    """Vertex from vertex."""
    apart = np.linalg.norm(skin.vertices - other.vertices, axis=1)
    return Distance(float(apart.mean()), float(np.quantile(apart, 0.95)))


def rotations(skin: Surface, landmarks: Landmarks) -> list[float]:
    """Back surface rotation at LEVELS, 0 where there is none [degrees]."""
    found = measure(skin, landmarks).bsr
    return [float(np.nan_to_num(found[level] or 0.0)) for level in LEVELS]


@dataclass(frozen=True)
class Shoulders:
    """Shoulders and the upper back under them, whose horizontal section turns as they slope."""

    higher: float
    """By how much the right one stands higher [mm]."""
    rotations: list[float]
    """BSR at T1 and T2, of sections along the shoulders [degrees]."""


def shoulders(skin: Surface, landmarks: Landmarks) -> Shoulders:
    """Shoulders of a skin, 0 where they are missing."""
    found = measure(skin, landmarks).shoulders
    along = [angle or 0.0 for angle in rotation_along_shoulders(skin, landmarks).values()]
    return Shoulders(0.0 if found is None else found.difference, along)


def apex_of(before: list[float]) -> int:
    """The level where back surface rotation is largest."""
    return int(np.abs(before[HUMP]).argmax()) + HUMP.start


@dataclass(frozen=True)
class Row:
    """A plan for a virtual patient, simulated one way."""

    patient: str
    """Kind and Cobb angle of the curve."""
    correction: float
    """The part of it that surgery takes away."""
    way: str
    """How its bones are moved."""
    derotation: float
    """Of the apical vertebra [degrees]."""
    before: list[float]
    """Back surface rotation (BSR) by level [degrees]."""
    after: list[float]
    """The same after."""
    shoulders_before: Shoulders
    """Shoulders and upper back before."""
    shoulders_after: Shoulders
    """The same after."""
    less: list[float] | None
    """The same with less derotation at the same Cobb angle; None where that was not simulated."""
    smooth: Smoothness
    """The skin."""
    truth_before: Distance
    """How far the skin before lies from that on which the corrected curve is imposed."""
    truth_after: Distance
    """The same of the predicted skin."""
    iterations: int
    """Linear iterations of all increments."""
    inverted: int
    """Tetrahedra without positive volume."""
    status: str
    """Why the last relaxation ended."""

    @property
    def apex(self) -> int:
        """The level where BSR was largest."""
        return apex_of(self.before)

    @property
    def change(self) -> np.ndarray:
        """Of BSR by level [degrees]."""
        return np.subtract(self.after, self.before)

    @property
    def over_cobb(self) -> float:
        """The part of the hump that is gone, over that of the Cobb angle."""
        return (1.0 - abs(self.after[self.apex] / self.before[self.apex])) / self.correction

    @property
    def of_less(self) -> float:
        """What less derotation changes at the apex [degrees]; NaN where that was not simulated."""
        return float("nan") if self.less is None else abs(self.less[self.apex] - self.after[self.apex])

    @property
    def along(self) -> np.ndarray:
        """Change of BSR at T1 and T2, of sections along the shoulders [degrees]."""
        return np.subtract(self.shoulders_after.rotations, self.shoulders_before.rotations)

    def quiet(self, levels: slice) -> bool:
        """Whether none of some levels changes by more than the apex."""
        return self._least(self.change[levels])

    @property
    def quiet_along(self) -> bool:
        """Whether T1 and T2, of sections along the shoulders, change by no more than the apex."""
        return self._least(self.along)

    def _least(self, changes: np.ndarray) -> bool:
        return bool(np.abs(changes).max() <= abs(self.change[self.apex]))
