"""The positions of the sliders and the plan that they define."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from warp_trunk.bone_motion.plan import CurvePlan, Plan
from warp_trunk.bone_motion.plan.record import rank
from warp_trunk.measures import cobb_angles
from warp_trunk.measures.apical import axial_rotation
from warp_trunk.measures.sagittal import kyphosis
from warp_trunk.measures.spine import asis_axis, spine_of

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.measures import CobbAngle

KYPHOSIS = "T5-T12"
"""The ends of the kyphosis that a plan sets."""


@dataclass(frozen=True)
class Spine:
    """Data of the spine before surgery, from which sliders are made."""

    levels: tuple[str, ...]
    """Vertebrae with landmarks, top to bottom."""
    curves: tuple[CobbAngle, ...]
    """Its curves, top to bottom."""
    rotation: Mapping[str, float]
    """Axial rotation of each apex [degrees]."""
    kyphosis: float | None
    """Kyphosis T5-T12 [degrees]; None where it has no landmarks."""


@dataclass(frozen=True, kw_only=True)
class Wish:
    """Where the sliders stand. One is equal to another where they stand alike."""

    uiv: str
    """Upper fused vertebra."""
    liv: str
    """Lower fused vertebra."""
    correction: Mapping[str, int] = field(default_factory=dict)
    """Share of each curve's Cobb angle that surgery takes away, by apex [%]."""
    derotation: Mapping[str, int] = field(default_factory=dict)
    """Share of the apex' axial rotation that surgery takes away, by apex [%]."""
    kyphosis: int | None = None
    """Kyphosis T5-T12 after [degrees]; None keeps it."""

    def fuses(self, level: str) -> bool:
        """Whether a vertebra is in the fusion; a curve whose apex is not follows by itself."""
        return rank(self.uiv) <= rank(level) <= rank(self.liv)

    def plan(self, base: Plan | None = None) -> Plan:
        """The plan that it is; what sliders do not say is that of another.

        A curve in the fusion at 0 % keeps its angle, and an apex at 0 % is not turned on purpose. With all sliders
        at rest nothing is asked, and nothing moves.

        Raises:
            InputError: levels in the wrong order, or a number that no slider has.
        """
        levels = replace(base or Plan(uiv=self.uiv, liv=self.liv), uiv=self.uiv, liv=self.liv, curves=())
        curves = tuple(
            CurvePlan(
                apex=apex,
                correction=share / 100.0,
                derotation=self.derotation.get(apex, 0) / 100.0 if self.derotation.get(apex) else None,
            )
            for apex, share in self.correction.items()
            if self.fuses(apex)
        )
        asked = any(curve.correction or curve.derotation for curve in curves)
        return replace(
            levels,
            curves=curves if asked or self.kyphosis is not None else (),
            kyphosis_T5_T12=None if self.kyphosis is None else float(self.kyphosis),
        )


def spine_before(landmarks: Landmarks) -> Spine:
    """The data from which sliders are made."""
    spine = spine_of(landmarks)
    rotation = axial_rotation(spine, asis_axis(landmarks))
    curves = cobb_angles(landmarks)
    return Spine(
        levels=landmarks.vertebrae(),
        curves=curves,
        rotation={curve.apex: rotation[curve.apex] or 0.0 for curve in curves},
        kyphosis=kyphosis(spine)[KYPHOSIS],
    )


def first_wish(spine: Spine, plan: Plan | None = None) -> Wish:
    """Where the sliders stand at the beginning: at a plan, or at rest with the largest curve fused.

    A plan's `cobb_after` and `rotation_after` become the shares that they are, to a whole per cent.
    """
    still = dict.fromkeys((curve.apex for curve in spine.curves), 0)
    if plan is None:
        largest = max(spine.curves, key=lambda curve: curve.angle, default=None)
        ends = (spine.levels[0], spine.levels[-1]) if largest is None else (largest.upper, largest.lower)
        return Wish(uiv=ends[0], liv=ends[1], correction=still, derotation=still)
    correction, derotation = dict(still), dict(still)
    for asked in plan.curves:
        apex = _curve_of(asked.apex, spine)
        if apex is None:
            continue
        curve = next(one for one in spine.curves if one.apex == apex)
        correction[apex] = _percent(asked.correction, asked.cobb_after, curve.angle)
        derotation[apex] = _percent(asked.derotation, asked.rotation_after, abs(spine.rotation[apex]))
    kept = plan.kyphosis_T5_T12
    return Wish(
        uiv=plan.uiv,
        liv=plan.liv,
        correction=correction,
        derotation=derotation,
        kyphosis=None if kept is None else round(kept),
    )


def _curve_of(level: str, spine: Spine) -> str | None:
    """The apex of the curve that a level is in, the nearest where it is in two."""
    rows = {name: row for row, name in enumerate(spine.levels)}
    around = [c for c in spine.curves if level in rows and rows[c.upper] <= rows[level] <= rows[c.lower]]
    nearest = min(around, key=lambda c: abs(rows[c.apex] - rows[level]), default=None)
    return None if nearest is None else nearest.apex


def _percent(share: float | None, after: float | None, before: float) -> int:
    if share is None:
        share = 0.0 if after is None or before == 0.0 else 1.0 - after / before
    return round(100.0 * min(max(share, 0.0), 1.0))
