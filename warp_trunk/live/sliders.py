"""The sliders of a patient, where they stand first, and the surgery that they ask for."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from warp_trunk.bone_motion.plan import CurvePlan, Plan, PlannedSurgery, Planner
from warp_trunk.bone_motion.plan.record import rank
from warp_trunk.case import Case
from warp_trunk.case.motions import Motion, Turn, rigid_motions
from warp_trunk.measures import cobb_angles
from warp_trunk.measures.apical import axial_rotation
from warp_trunk.measures.sagittal import kyphosis
from warp_trunk.measures.spine import asis_axis, spine_of

from .motion_plan import MotionPlan, plan_motions

Wish = Mapping[str, Any]
"""Where the controls of a patient stand: the value of each by its name."""
KYPHOSIS = (0, 90, 1)
"""Range of the kyphosis T5-T12 after surgery [degrees]."""
REACH = 20
"""A slider of a motion reaches at least this far to either side [mm or degrees]."""
COMPONENTS = ("Left mm", "Back mm", "Up mm", "Pitch °", "Roll °", "Yaw °")
"""Labels of the components of a motion: translation along and rotation vector about x, y and z in LPS."""
_STILL = Motion(transform=((1.0, 0, 0, 0), (0, 1.0, 0, 0), (0, 0, 1.0, 0), (0, 0, 0, 1.0)))


@dataclass(frozen=True)
class Control:
    """A slider, or a list where it has choices."""

    folder: str
    """The heading above it."""
    label: str
    """Its name on the page."""
    first: Any
    """Its first value."""
    span: tuple[float, float, float] = (0, 100, 1)
    """Its least and its largest value, and its step."""
    choices: tuple[str, ...] = ()
    """The values of a list."""
    hint: str | None = None
    """What it means."""


class SpineSliders:
    """Controls for every curve, the kyphosis and the ends of the fusion."""

    def __init__(self, case: Case, base: Plan | None = None) -> None:
        """Controls that stand at a plan, or at rest with the largest curve fused.

        A plan's `cobb_after` and `rotation_after` become the shares that they are, to a whole per cent.

        Args:
            case: the patient.
            base: the first plan, which also holds what no slider says.
        """
        before = case.landmarks_before
        spine, self._levels = spine_of(before), before.vertebrae()
        self._planner, self._base = Planner(case), base
        self._curves = {curve.apex: curve for curve in cobb_angles(before)}
        self._rotation = axial_rotation(spine, asis_axis(before))
        largest = max(self._curves.values(), key=lambda curve: curve.angle, default=None)
        uiv, liv = (self._levels[0], self._levels[-1]) if largest is None else (largest.upper, largest.lower)
        shares: dict[str, int] = {}
        if base is not None:
            uiv, liv, shares = base.uiv, base.liv, self._shares(base)
        self.controls = {
            "uiv": Control("Fusion", "Upper vertebra", uiv, choices=self._levels),
            "liv": Control("Fusion", "Lower vertebra", liv, choices=self._levels),
        }
        """The controls by name."""
        for apex, curve in self._curves.items():
            folder = f"Curve {curve.upper}-{curve.lower}, {curve.convex}, {curve.angle:.0f}°"
            for name, angle in (("correction", "Cobb angle"), ("derotation", f"axial rotation of {apex}")):
                key, hint = f"{name} {apex}", f"Share of the {angle} that surgery takes away"
                label = f"{name.capitalize()} %"
                self.controls[key] = Control(folder, label, shares.get(key, 0), hint=hint)
        now, asked = kyphosis(spine)["T5-T12"], None if base is None else base.kyphosis_T5_T12
        if now is not None:
            self._still = min(max(round(now), KYPHOSIS[0]), KYPHOSIS[1])
            hint = f"Before surgery {now:.0f}°, which is kept where the slider stands there"
            first = self._still if asked is None else round(asked)
            self.controls["kyphosis"] = Control("Kyphosis", "T5-T12 °", first, KYPHOSIS, hint=hint)

    def plan(self, wish: Wish) -> Plan:
        """The plan of the controls; what they do not say is that of the first plan.

        A curve in the fusion at 0 % keeps its angle, and an apex at 0 % is not turned on purpose. With all sliders
        at rest nothing is asked, and nothing moves.

        Raises:
            InputError: levels in the wrong order, or a number that no slider has.
        """
        ends = {"uiv": wish["uiv"], "liv": wish["liv"]}
        plan = replace(self._base or Plan(**ends), **ends, curves=(), kyphosis_T5_T12=None)
        curves = []
        for apex in self._curves:
            if rank(plan.uiv) <= rank(apex) <= rank(plan.liv):
                correction, derotation = (wish[f"{name} {apex}"] / 100.0 for name in ("correction", "derotation"))
                curves.append(CurvePlan(apex, correction=correction, derotation=derotation or None))
        kept = "kyphosis" not in wish or wish["kyphosis"] == self._still
        if kept and not any(curve.correction or curve.derotation for curve in curves):
            return plan
        return replace(plan, curves=curves, kyphosis_T5_T12=None if kept else float(wish["kyphosis"]))

    def surgery(self, wish: Wish) -> PlannedSurgery:
        """The surgery that the controls ask for; InputError if the spine cannot meet it."""
        return self.of_plan(self.plan(wish))

    def of_plan(self, plan: Plan) -> PlannedSurgery:
        """The surgery that a plan asks for; InputError if the spine cannot meet it."""
        return self._planner.plan(plan)

    def without_effect(self, wish: Wish) -> set[str]:
        """The controls of curves outside the fusion, which follow by themselves."""
        uiv, liv = rank(wish["uiv"]), rank(wish["liv"])
        outside = [apex for apex in self._curves if not uiv <= rank(apex) <= liv]
        return {f"{name} {apex}" for apex in outside for name in ("correction", "derotation")}

    def _shares(self, plan: Plan) -> dict[str, int]:
        """The values of the sliders of each curve that a plan names by any of its levels."""
        rows, found = {name: row for row, name in enumerate(self._levels)}, {}
        for asked in plan.curves:
            at = rows.get(asked.apex, -1)
            around = [c for c in self._curves.values() if rows[c.upper] <= at <= rows[c.lower]]
            if around:
                curve = min(around, key=lambda c: abs(rows[c.apex] - at))
                turned = abs(self._rotation[curve.apex] or 0.0)
                found[f"correction {curve.apex}"] = _percent(asked.correction, asked.cobb_after, curve.angle)
                found[f"derotation {curve.apex}"] = _percent(asked.derotation, asked.rotation_after, turned)
        return found


def _percent(share: float | None, after: float | None, before: float) -> int:
    if share is None:
        share = 0.0 if after is None or before == 0.0 else 1.0 - after / before
    return round(100.0 * min(max(share, 0.0), 1.0))


class MotionSliders:
    """A slider for each component of the motion of each bone of motions.toml."""

    def __init__(self, case: Case) -> None:
        """Controls that stand at the motions of a case with handles (`with_handles`).

        A transform becomes a rotation about the centre of its bone, and a translation.
        """
        self._case, moved = case, rigid_motions(case.motions)
        self._points: dict[str, tuple[float, float, float]] = {}
        self.controls: dict[str, Control] = {}
        """The controls by name."""
        for bone, motion in case.motions.items():
            for other, share in (motion.follows or {}).items():
                first = round(100.0 * share, 1)
                self.controls[f"{bone} {other}"] = Control(bone, f"Follows {other} %", first, (0, 100, 0.1))
            if motion.follows is None:
                turn, own = motion.rotation, moved[bone]
                point = case.bones[bone].vertices.mean(axis=0) if turn is None else np.array(turn.point)
                x, y, z = np.round(point, 9).tolist()
                self._points[bone] = (x, y, z)
                values = [*(own.apply(point) - point), *own.rotation.as_rotvec(degrees=True)]
                for label, value in zip(COMPONENTS, np.round(values, 9).tolist(), strict=True):
                    most = max(REACH, math.ceil(2.0 * abs(value)))
                    self.controls[f"{bone} {label}"] = Control(bone, label, value, (-most, most, 0.1))

    def motions(self, wish: Wish) -> dict[str, Motion]:
        """The motions that the controls describe, by bone."""
        return {bone: self._motion(bone, given, wish) for bone, given in self._case.motions.items()}

    def _motion(self, bone: str, given: Motion, wish: Wish) -> Motion:
        if given.follows is not None:
            shares = {other: wish[f"{bone} {other}"] / 100.0 for other in given.follows}
            shares = {other: share for other, share in shares.items() if share > 0.0}
            return Motion(follows=shares) if shares else _STILL
        x, y, z, *rotation = (wish[f"{bone} {label}"] for label in COMPONENTS)
        degrees = float(np.linalg.norm(rotation))
        if not (degrees or x or y or z):
            return _STILL
        axis = (rotation[0], rotation[1], rotation[2])
        turn = Turn(degrees=degrees, axis=axis, point=self._points[bone]) if degrees else None
        return Motion(translation=(x, y, z), rotation=turn, large=given.large)

    def surgery(self, wish: Wish) -> MotionPlan:
        """Where the controls take the bones; InputError if they cannot move like this."""
        return plan_motions(self._case, self.motions(wish))

    def without_effect(self, _: Wish) -> set[str]:
        """None of the controls."""
        return set()


Sliders = SpineSliders | MotionSliders


def first_wish(sliders: Sliders) -> Wish:
    """Where the controls stand first."""
    return {name: control.first for name, control in sliders.controls.items()}
