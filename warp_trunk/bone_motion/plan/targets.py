"""The targets of a plan as functions of the change of the vertebrae's angles."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.measures.trunk_shift import sacral_line

from .posture import AXIAL, CORONAL, Placed
from .record import rank

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.measures.cobb import CobbAngle

    from .posture import Posture
    from .record import CurvePlan, Plan

HALF = 0.5
"""Share of an unfused curve that corrects by itself where nothing is known of it: lumbar curves went from 43.9 to
22.0 degrees after selective thoracic fusion (24 patients; Ishikawa et al., J Orthop Sci 2015, 20:31)."""


@dataclass(frozen=True, eq=False)
class Reading:
    """One number of a spine, and how it changes with the angles of the vertebrae."""

    value: float
    """Degrees or mm."""
    slope: np.ndarray
    """Its derivative in each angle [per degree], shape (n, 3)."""

    def signed(self, sign: float) -> Reading:
        """The number times 1 or -1."""
        return Reading(sign * self.value, sign * self.slope)


@dataclass(frozen=True, eq=False)
class Target:
    """One number that the spine must have after surgery."""

    name: str
    """Its name in messages."""
    unit: str
    """Its unit."""
    goal: float
    """The value that is asked for."""
    read: Callable[[Placed], Reading]
    """Its value for placed vertebrae."""
    part: tuple[int, int, int] | None = None
    """Plane, and first and last vertebra of the part whose bends change in proportion to meet it."""


@dataclass(frozen=True)
class Curve:
    """A curve before surgery with what is planned for it."""

    before: CobbAngle
    """The curve; its end vertebrae are those it is judged by after, too."""
    plan: CurvePlan | None
    """The targets of the curve."""
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

    def row(self, level: str) -> int:
        """Where a level stands in the chain; InputError where it has no landmarks."""
        if level not in self.posture.levels:
            first, last = self.posture.levels[0], self.posture.levels[-1]
            raise InputError(f"plan: '{level}' has no landmarks; name a level of {first} to {last}")
        return self.posture.levels.index(level)

    @cached_property
    def still(self) -> Placed:
        """The vertebrae as they stand before surgery."""
        return Placed(self.posture, self.posture.still)

    def coronal(self, upper: str, lower: str, placed: Placed) -> Reading:
        """Tilt of one vertebra less that of another [degrees]."""
        slope, tilt = np.zeros_like(placed.change), self.posture.angles[:, CORONAL] + placed.change[:, CORONAL]
        above, below = self.row(upper), self.row(lower)
        slope[above, CORONAL], slope[below, CORONAL] = 1.0, -1.0
        return Reading(float(tilt[above] - tilt[below]), slope)

    def sagittal(self, upper: str, lower: str, placed: Placed) -> Reading:
        """Lean of one vertebra less that of another as seen from the side [degrees], positive to the back."""
        slope, lean = np.zeros_like(placed.change), []
        for sign, row in ((1.0, self.row(upper)), (-1.0, self.row(lower))):
            _, y, z = placed.axes[row].tolist()
            lean.append(math.degrees(math.atan2(y, z)))
            slope[row, :AXIAL] = placed.axis_slopes[row, :, 1:] @ [z, -y]
            slope[row] *= sign * math.degrees(1.0 / (y * y + z * z))
        return Reading(lean[0] - lean[1], slope)

    def rotation(self, level: str, placed: Placed) -> Reading:
        """Pedicles against the pelvis seen from above, positive when the right side is behind [degrees]."""
        row = self.row(level)
        line = placed.carried(row, self.posture.across[row])
        (u, v, _), (x, y) = line.tolist(), self.pelvis.tolist()
        slope = np.zeros_like(placed.change)
        slope[row] = placed.turned(row, line)[:, :2] @ [v, -u]
        slope[row] *= math.degrees(1.0 / (u * u + v * v))
        return Reading(-math.degrees(math.atan2(x * v - y * u, x * u + y * v)), slope)

    def plumb(self, column: int, placed: Placed) -> Reading:
        """How far T1 stands to the right (column 0) or in front (1) of the sacrum [mm]."""
        x, y = self.pelvis.tolist()
        along = np.array([[-x, -y], [y, -x]][column])
        return Reading(float((placed.top[:2] - self.sacrum) @ along), placed.top_slope[..., :2] @ along)


def measured(posture: Posture, landmarks: Landmarks) -> Measured:
    """The measures of a posture; InputError without iliac spines."""
    line = sacral_line(landmarks)
    return Measured(posture, line.across, line.point)


def curves_of_plan(
    curves: tuple[CobbAngle, ...], levels: tuple[str, ...], plan: Plan, flexibility: Mapping[str, float]
) -> tuple[Curve, ...]:
    """Every curve of the spine, each with what is planned for it.

    Args:
        curves: those before surgery.
        levels: the vertebrae, top to bottom.
        plan: the plan.
        flexibility: of curves by their apex, where it is known.

    Raises:
        InputError: a planned curve that the spine does not have or does not fuse, or two for one curve.
    """
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
    still = spine.still
    apices = [spine.row(curve.before.apex) for curve in curves]
    targets: list[Target] = []
    corrects = any(curve.corrects for curve in curves)
    for number, curve in enumerate(curves):
        if (curve.plan is not None and not curve.corrects) or not corrects:
            targets.append(_kept(spine, curve))
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
            targets.append(Target(name, "degrees", angle(still).value if wanted is None else wanted, angle))
    aside, forward = partial(spine.plumb, 0), partial(spine.plumb, 1)
    beside = aside(still).value if plan.balance == "keep" else 0.0
    before = forward(still).value if plan.sva_after is None else plan.sva_after
    return [*targets, Target("coronal balance", "mm", beside, aside), Target("sva_after", "mm", before, forward)]


def _of_curve(spine: Measured, asked: CurvePlan, curve: CobbAngle, around: tuple[int, int]) -> list[Target]:
    """Cobb angle and rotation of a curve, each positive before; `around` are the next apices."""
    posture, apex = spine.posture, spine.row(asked.apex)
    tilt, turn = partial(spine.coronal, curve.upper, curve.lower), partial(spine.rotation, asked.apex)
    bent, turned = tilt(spine.still).value, turn(spine.still).value
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


def _signed(sign: float, read: Callable[[Placed], Reading], placed: Placed) -> Reading:
    return read(placed).signed(sign)


def _kept(spine: Measured, curve: Curve) -> Target:
    tilt = partial(spine.coronal, curve.before.upper, curve.before.lower)
    return Target(f"curve {curve.before.apex} kept, an angle of", "degrees", tilt(spine.still).value, tilt)


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
            goal = (1.0 - curve.spontaneous) * tilt(spine.still).value
            targets.append(Target(name, "degrees", goal, tilt, (CORONAL, upper, lower)))
    return targets
