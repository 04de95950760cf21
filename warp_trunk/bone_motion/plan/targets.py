"""What a plan asks for, as functions of the change of the vertebrae's angles."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.measures.cobb import CobbAngle, cobb_angles
from warp_trunk.measures.spine import spine_of
from warp_trunk.measures.trunk_shift import sacral_line, top_of_spine

from .posture import AXIAL, CORONAL, Placed
from .record import rank

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks

    from .posture import Posture
    from .record import CurvePlan, Plan

HALF = 0.5
"""Share of an unfused curve that corrects by itself where nothing is known of it: lumbar curves went from 43.9 to
22.0 degrees after selective thoracic fusion (24 patients; Ishikawa et al., J Orthop Sci 2015, 20:31)."""


@dataclass(frozen=True, eq=False)
class Target:
    """One number that the spine must have after surgery."""

    name: str
    """What it is, for a message."""
    unit: str
    """Its unit."""
    goal: float
    """What it must be."""
    value: Callable[[Placed], np.ndarray]
    """What it is when the vertebrae are placed so, one value for each change."""
    part: tuple[int, int, int] | None = None
    """Plane, and first and last vertebra of the part whose bends change in proportion to meet it."""


@dataclass(frozen=True)
class Curve:
    """A curve before surgery with what is planned for it."""

    before: CobbAngle
    """The curve; its end vertebrae are those it is judged by after, too."""
    plan: CurvePlan | None
    """What is asked of it."""
    spontaneous: float
    """Share of its part outside the fusion that corrects by itself."""
    flexibility: float | None
    """Share of its Cobb angle that bent out on a film of side bending; None without films."""

    @property
    def corrects(self) -> bool:
        """Whether a Cobb angle after is asked for."""
        return self.plan is not None and (self.plan.correction is not None or self.plan.cobb_after is not None)


@dataclass(frozen=True, eq=False)
class Measured:
    """The measures of a chain of vertebrae that targets are of."""

    posture: Posture
    pelvis: np.ndarray
    """Unit vector of the pelvis' axis to the left, x and y, shape (2,)."""
    sacrum: np.ndarray
    """Where the sacral line is, x and y [mm], shape (2,)."""
    top: int
    """The row of the vertebra whose balance is kept: C7, T1, or the uppermost there is."""

    def row(self, level: str) -> int:
        """Where a level stands in the chain; InputError where it has no landmarks."""
        if level not in self.posture.levels:
            first, last = self.posture.levels[0], self.posture.levels[-1]
            raise InputError(f"plan: '{level}' has no landmarks; name a level of {first} to {last}")
        return self.posture.levels.index(level)

    def coronal(self, upper: str, lower: str, placed: Placed) -> np.ndarray:
        """Tilt of one vertebra less that of another [degrees]."""
        rows = [self.row(upper), self.row(lower)]
        before, change = self.posture.angles[rows, CORONAL], placed.change[..., rows, CORONAL]
        return before[0] - before[1] + change[..., 0] - change[..., 1]

    def sagittal(self, upper: str, lower: str, placed: Placed) -> np.ndarray:
        """Lean of one vertebra less that of another as seen from the side [degrees], positive to the back."""
        axes = placed.axes[..., [self.row(upper), self.row(lower)], :]
        lean = np.degrees(np.arctan2(axes[..., 1], axes[..., 2]))
        return lean[..., 0] - lean[..., 1]

    def rotation(self, level: str, placed: Placed) -> np.ndarray:
        """Pedicles against the pelvis seen from above, positive when the right side is behind [degrees]."""
        row = self.row(level)
        line = placed.carried(row, self.posture.across[row])
        x, y = self.pelvis
        return -np.degrees(np.arctan2(x * line[..., 1] - y * line[..., 0], x * line[..., 0] + y * line[..., 1]))

    def plumb(self, column: int, placed: Placed) -> np.ndarray:
        """How far T1 stands to the right (column 0) or in front (1) of the sacrum [mm]."""
        centroid = placed.endplates[..., self.top, 1, :] + placed.carried(
            self.top, self.posture.centroids[self.top]
        )
        x, y = self.pelvis
        return -(centroid[..., :2] - self.sacrum) @ ([x, y], [-y, x])[column]


def measured(posture: Posture, landmarks: Landmarks) -> Measured:
    """The measures of a posture; InputError without iliac spines."""
    line, top = sacral_line(landmarks), top_of_spine(spine_of(landmarks))
    return Measured(posture, line.across, line.point, 0 if top is None else posture.levels.index(top))


def curves_of_plan(landmarks: Landmarks, plan: Plan, flexibility: Mapping[str, float]) -> tuple[Curve, ...]:
    """Every curve of the spine, each with what is planned for it.

    Args:
        landmarks: before surgery.
        plan: the plan.
        flexibility: of curves by their apex, where it is known.

    Raises:
        InputError: a planned curve that the spine does not have or does not fuse, or two for one curve.
    """
    curves, levels = cobb_angles(landmarks), landmarks.vertebrae()
    wanted: dict[CobbAngle, CurvePlan] = {}
    for asked in plan.curves:
        curve = _curve_at(asked.apex, curves, levels)
        if curve in wanted:
            known = f"{curve.upper} to {curve.lower} is the curve of {wanted[curve].apex} already"
            raise InputError(f"curve {asked.apex}: {known}; give each curve once")
        if not rank(plan.uiv) <= rank(asked.apex) <= rank(plan.liv):
            fused = f"{plan.uiv} to {plan.liv}"
            raise InputError(f"curve {asked.apex}: is outside the fusion, {fused}; fuse it or leave it out")
        wanted[curve] = asked
    corrected = max((_correction(asked, curve.angle) for curve, asked in wanted.items()), default=0.0)
    found = []
    for curve in curves:
        bent_out = flexibility.get(curve.apex)
        share = plan.spontaneous if plan.spontaneous is not None else HALF if bent_out is None else bent_out
        found.append(Curve(curve, wanted.get(curve), min(max(share, 0.0), corrected), bent_out))
    return tuple(found)


def _correction(asked: CurvePlan, angle: float) -> float:
    if asked.cobb_after is not None:
        return min(max(1.0 - asked.cobb_after / angle, 0.0), 1.0)
    return asked.correction or 0.0


def _curve_at(apex: str, curves: tuple[CobbAngle, ...], levels: tuple[str, ...]) -> CobbAngle:
    row = levels.index(apex) if apex in levels else -1
    around = [c for c in curves if row >= 0 and levels.index(c.upper) <= row <= levels.index(c.lower)]
    if not around:
        known = ", ".join(f"{c.upper} to {c.lower} with apex {c.apex}" for c in curves) or "none of 10 degrees"
        raise InputError(f"curve {apex}: {apex} is in no curve of this spine, which has {known}; name an apex")
    return min(around, key=lambda c: abs(levels.index(c.apex) - row))


def targets_of(spine: Measured, plan: Plan, curves: tuple[Curve, ...]) -> list[Target]:
    """Every target of a plan, those of what is kept included; see docs/planning.md."""
    still = Placed(spine.posture, spine.posture.still)
    apices = [spine.row(curve.before.apex) for curve in curves]
    targets: list[Target] = []
    corrects = any(curve.corrects for curve in curves)
    for number, curve in enumerate(curves):
        if (curve.plan is not None and not curve.corrects) or not corrects:
            targets.append(_kept(spine, curve, still))
        if curve.plan is not None:
            around = [0, *apices][number], [*apices[1:], len(spine.posture.levels) - 1][number]
            targets += _of_curve(spine, curve.plan, curve.before, around)
        elif plan.unfused == "follow" and corrects:
            targets += _outside(spine, plan, curve)
    for name, upper, lower, wanted in (
        ("kyphosis_T5_T12", "T12", "T5", plan.kyphosis_T5_T12),
        ("lordosis_L1_L5", "L1", "L5", plan.lordosis_L1_L5),
    ):
        if wanted is not None or {upper, lower} <= set(spine.posture.levels):
            angle = partial(spine.sagittal, upper, lower)
            targets.append(Target(name, "degrees", float(angle(still)) if wanted is None else wanted, angle))
    aside, forward = partial(spine.plumb, 0), partial(spine.plumb, 1)
    beside = float(aside(still)) if plan.balance == "keep" else 0.0
    before = float(forward(still)) if plan.sva_after is None else plan.sva_after
    return [*targets, Target("coronal balance", "mm", beside, aside), Target("sva_after", "mm", before, forward)]


def _of_curve(spine: Measured, asked: CurvePlan, curve: CobbAngle, around: tuple[int, int]) -> list[Target]:
    """Cobb angle and rotation of a curve, each positive before; `around` are the next apices."""
    posture, apex = spine.posture, spine.row(asked.apex)
    still = Placed(posture, posture.still)
    tilt, turn = partial(spine.coronal, curve.upper, curve.lower), partial(spine.rotation, asked.apex)
    bent, turned = float(tilt(still)), float(turn(still))
    rotation, (first, last) = np.abs(posture.angles[:, AXIAL]), around
    neutral = first + int(np.argmin(rotation[first : apex + 1])), apex + int(np.argmin(rotation[apex : last + 1]))
    targets = []
    for name, value, before, share, after, part in (
        ("Cobb angle", tilt, bent, asked.correction, asked.cobb_after,
         (CORONAL, spine.row(curve.upper), spine.row(curve.lower))),
        ("rotation", turn, turned, asked.derotation, asked.rotation_after, (AXIAL, *neutral)),
    ):  # fmt: skip
        goal = after if share is None else (1.0 - share) * abs(before)
        if goal is not None:
            signed = partial(_signed, float(np.copysign(1.0, before)), value)
            targets.append(Target(f"curve {asked.apex}: {name} after", "degrees", goal, signed, part))
    return targets


def _signed(sign: float, value: Callable[[Placed], np.ndarray], placed: Placed) -> np.ndarray:
    return sign * value(placed)


def _kept(spine: Measured, curve: Curve, still: Placed) -> Target:
    tilt = partial(spine.coronal, curve.before.upper, curve.before.lower)
    return Target(f"curve {curve.before.apex} kept, an angle of", "degrees", float(tilt(still)), tilt)


def _outside(spine: Measured, plan: Plan, curve: Curve) -> list[Target]:
    """The part of an unplanned curve above and below the fusion, which corrects by itself."""
    if curve.spontaneous == 0.0:
        return []
    levels = spine.posture.levels
    first, last = levels.index(curve.before.upper), levels.index(curve.before.lower)
    targets = []
    for upper, lower in ((first, min(last, spine.row(plan.uiv))), (max(first, spine.row(plan.liv)), last)):
        if upper < lower:
            tilt = partial(spine.coronal, levels[upper], levels[lower])
            name = f"spontaneous correction of {levels[upper]} to {levels[lower]}, an angle of"
            goal = (1.0 - curve.spontaneous) * float(tilt(Placed(spine.posture, spine.posture.still)))
            targets.append(Target(name, "degrees", goal, tilt, (CORONAL, upper, lower)))
    return targets
