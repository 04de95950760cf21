"""The targets of a plan as functions of the change of the vertebrae's angles."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import methodcaller

import numpy as np

from warp_trunk.case.anatomy import rank
from warp_trunk.errors import InputError
from warp_trunk.spine.cobb import CobbAngle

from .record import CurvePlan, Plan
from .spine_chain import AXIAL, CORONAL, Placed, SpineChain

FOLLOWS = 0.75
"""Share of an unfused curve that corrects by itself over that of the fused curves, where nothing is known of it.

Lumbar curves below a thoracic fusion: 0.72 (32 patients, Lenke 1B and 1C), 0.76 (121; Sullivan et al.), 0.98 (37;
cantilever bending) and 0.94 (28; Choi et al. 2008, Asian Spine J 2:81). Upper thoracic curves: 0.66 (56; Smyrnis
et al. 2009, Eur Spine J 18:522).
"""
COMES_HOME = 0.18
"""Part of the coronal imbalance before surgery that each free disc below the fusion takes back: 0.9 with the five
below L1. Patients who leaned to the left by 24 and by 36 mm stood 18 and 19 mm to the left two years after
selective thoracic fusion to L1 or above (121 and 47 patients), of which `LEANS` is the greater part.

Lumbar fusions judge it: with the three discs below L3 about half remains, and two years after T1 stands more than
20 mm aside in 15 % of 264 patients (docs/change.md), most of all where L5 is fused (56 patients,
doi 10.1186/s12891-018-2135-2).
"""
LEANS = 0.65
"""How far T1 stands to the convex side of a curve on which the fusion ends, for each degree that is left of it
[mm/degree]: 18 mm at 23 degrees in the first of these studies.

Two others judge it: -5.6 to -14.6 mm at 22.0 degrees (24 patients; Ishikawa et al., J Orthop Sci 2015, 20:31) and
-3.8 to -12.0 mm at 22.5 (21; Scoliosis Spinal Disord 2017, 12:16).
"""
ADAPTED = 0.5
"""Share of the Cobb angle from which the posture is that of these patients; less is operated, less it changes."""


@dataclass(frozen=True, eq=False)
class Target:
    """One number that the spine must have after surgery."""

    name: str
    """Its name in messages."""
    unit: str
    """Its unit."""
    goal: float
    """The value that is asked for."""
    read: Callable[[Placed], np.ndarray]
    """Its value for placed vertebrae, but for the sign."""
    part: tuple[int, int, int] | None = None
    """Plane, and first and last vertebra of the part whose bends change in proportion to meet it."""
    sign: float = 1.0
    """By which the value is multiplied."""

    def off(self, placed: Placed) -> np.ndarray:
        """The value less the goal, for each change of the vertebrae, shape (...)."""
        return self.sign * self.read(placed) - self.goal


@dataclass(frozen=True)
class PlannedCurve:
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


def curves_of_plan(
    curves: tuple[CobbAngle, ...], levels: tuple[str, ...], plan: Plan, flexibility: Mapping[str, float]
) -> tuple[PlannedCurve, ...]:
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
            taken = f"{curve.upper} to {curve.lower} is the curve of {wanted[curve].apex} already"
            raise InputError(f"curve {asked.apex}: {taken}; give each curve once")
        if not rank(plan.uiv) <= rank(asked.apex) <= rank(plan.liv):
            fused = f"{plan.uiv} to {plan.liv}"
            raise InputError(f"curve {asked.apex}: is outside the fusion, {fused}; fuse it or leave it out")
        wanted[curve] = asked
    corrected = _corrected(wanted.items())
    planned = []
    for curve in curves:
        bent_out = flexibility.get(curve.apex)
        expected = FOLLOWS * corrected if bent_out is None else bent_out
        share = expected if plan.spontaneous is None else plan.spontaneous
        planned.append(PlannedCurve(curve, wanted.get(curve), min(max(share, 0.0), corrected), bent_out))
    return tuple(planned)


def _corrected(planned: Iterable[tuple[CobbAngle, CurvePlan | None]]) -> float:
    """The largest share of a Cobb angle that a plan takes away."""
    shares = [0.0]
    for curve, asked in planned:
        if asked is not None and asked.cobb_after is not None:
            shares.append(min(max(1.0 - asked.cobb_after / curve.angle, 0.0), 1.0))
        elif asked is not None and asked.correction is not None:
            shares.append(asked.correction)
    return max(shares)


def curve_around(level: str, curves: Iterable[CobbAngle], levels: Sequence[str]) -> CobbAngle | None:
    """The curve that a level lies in, of two that with the nearer apex; None where it lies in none.

    Args:
        level: the vertebra.
        curves: those of the spine.
        levels: the vertebrae, top to bottom.
    """
    rows = {name: row for row, name in enumerate(levels)}
    row = rows.get(level, -1)
    around = [curve for curve in curves if rows[curve.upper] <= row <= rows[curve.lower]]
    return min(around, key=lambda curve: abs(rows[curve.apex] - row), default=None)


def _curve_at(apex: str, curves: tuple[CobbAngle, ...], levels: tuple[str, ...]) -> CobbAngle:
    curve = curve_around(apex, curves, levels)
    if curve is None:
        listed = ", ".join(f"{c.upper} to {c.lower} with apex {c.apex}" for c in curves) or "none of 10 degrees"
        raise InputError(f"curve {apex}: {apex} is in no curve of this spine, which has {listed}; name an apex")
    return curve


def targets_of(chain: SpineChain, plan: Plan, curves: tuple[PlannedCurve, ...]) -> list[Target]:
    """Every target of a plan, those of what is kept included; see docs/planning.md."""
    still = Placed(chain, chain.still)
    apices = [chain.row(curve.before.apex) for curve in curves]
    targets: list[Target] = []
    corrects = any(curve.corrects for curve in curves)
    for number, curve in enumerate(curves):
        before = curve.before
        if (curve.plan is not None and not curve.corrects) or not corrects:
            tilt = methodcaller("coronal", before.upper, before.lower)
            targets.append(Target(f"curve {before.apex} kept, an angle of", "degrees", float(tilt(still)), tilt))
        if curve.plan is not None:
            around = [0, *apices][number], [*apices[1:], len(chain.levels) - 1][number]
            targets += _of_curve(still, curve.plan, before, around)
        elif plan.unfused == "follow" and corrects:
            targets += _outside(still, plan, curve)
    for name, unit, wanted, read in (
        ("kyphosis_T5_T12", "degrees", plan.kyphosis_T5_T12, methodcaller("sagittal", "T12", "T5")),
        ("lordosis_L1_L5", "degrees", plan.lordosis_L1_L5, methodcaller("sagittal", "L1", "L5")),
        ("coronal balance", "mm", _balance(still, plan, curves), methodcaller("plumb", 0)),
        ("sva_after", "mm", plan.sva_after, methodcaller("plumb", 1)),
    ):
        if wanted is not None or unit == "mm" or set(name.split("_")[1:]) <= set(chain.levels):
            targets.append(Target(name, unit, float(read(still)) if wanted is None else wanted, read))
    return targets


def _balance(still: Placed, plan: Plan, curves: tuple[PlannedCurve, ...]) -> float:
    """How far T1 is to stand to the right of the sacrum [mm]."""
    before = float(still.plumb(0))
    if plan.balance == "centre":
        return 0.0
    if plan.balance == "keep" or plan.unfused == "fixed":
        return before
    left_below = (
        math.copysign(
            (1.0 - curve.spontaneous) * curve.before.angle, 1.0 if curve.before.convex == "right" else -1.0
        )
        for curve in curves
        if curve.plan is None and rank(curve.before.upper) <= rank(plan.liv) < rank(curve.before.apex)
    )
    free_discs = len(still.chain.levels) - still.chain.row(plan.liv)
    after = max(1.0 - COMES_HOME * free_discs, 0.0) * before + LEANS * sum(left_below)
    adapted = min(_corrected((curve.before, curve.plan) for curve in curves) / ADAPTED, 1.0)
    return before + adapted * (after - before)


def _of_curve(still: Placed, asked: CurvePlan, curve: CobbAngle, around: tuple[int, int]) -> list[Target]:
    """Cobb angle and rotation of a curve, each positive before; `around` are the next apices."""
    chain, apex = still.chain, still.chain.row(asked.apex)
    turned, (first, last) = np.abs(chain.angles[:, AXIAL]), around
    neutral = first + int(np.argmin(turned[first : apex + 1])), apex + int(np.argmin(turned[apex : last + 1]))
    ends = chain.row(curve.upper), chain.row(curve.lower)
    targets = []
    for name, read, share, after, part in (
        ("Cobb angle", methodcaller("coronal", curve.upper, curve.lower), asked.correction, asked.cobb_after,
         (CORONAL, *ends)),
        ("rotation", methodcaller("rotation", asked.apex), asked.derotation, asked.rotation_after,
         (AXIAL, *neutral)),
    ):  # fmt: skip
        before = float(read(still))
        goal = after if share is None else (1.0 - share) * abs(before)
        if goal is not None:
            name, sign = f"curve {asked.apex}: {name} after", math.copysign(1.0, before)
            targets.append(Target(name, "degrees", goal, read, part, sign))
    return targets


def _outside(still: Placed, plan: Plan, curve: PlannedCurve) -> list[Target]:
    """The part of an unplanned curve above and below the fusion, which corrects by itself."""
    levels = still.chain.levels
    first, last = levels.index(curve.before.upper), levels.index(curve.before.lower)
    targets = []
    for upper, lower in ((first, min(last, levels.index(plan.uiv))), (max(first, levels.index(plan.liv)), last)):
        if upper < lower:
            tilt = methodcaller("coronal", levels[upper], levels[lower])
            name = f"spontaneous correction of {levels[upper]} to {levels[lower]}, an angle of"
            goal = (1.0 - curve.spontaneous) * float(tilt(still))
            targets.append(Target(name, "degrees", goal, tilt, (CORONAL, upper, lower)))
    return targets
