"""A planned surgery: where the plan takes every vertebra, and what becomes of the spine; as text, too."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from warp_trunk.measures.sagittal import kyphosis, lordosis, spine_height
from warp_trunk.measures.spine import spine_of
from warp_trunk.measures.trunk_shift import sacral_line, trunk_shift

if TYPE_CHECKING:
    from collections.abc import Sequence

    from warp_trunk.case import Case
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.measures import TrunkMeasures
    from warp_trunk.measures.cobb import CobbAngle

    from .record import Plan


@dataclass(frozen=True)
class VertebraMotion:
    """The planned motion of one vertebra."""

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
    """The planned change of one curve."""

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
    """Warnings for the surgeon, in sentences."""

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


SIGNS = """\
F: fused. Shift of the centre to the left, to the back and up. Tilt to the left, lean to the back, turn with the
right side going back; the same against the vertebra below. Rotation as `measure` has it."""


def surgery_text(surgery: PlannedSurgery) -> str:
    """The planned change of the curves, the whole spine and each vertebra, and the warnings."""
    plan = surgery.plan
    lines = [
        f"Fused {plan.uiv} to {plan.liv}, unfused segments {plan.unfused}",
        "",
        f"{'curve':<24}{'Cobb [°]':>16}{'':>8}{'apex rotation [°]':>20}{'bends out':>11}",
        *(_curve(curve) for curve in surgery.curves),
        "",
        f"{'spine':<32}{'before':>9}{'after':>9}{'change':>9}",
        *(_measure(name, before, after) for name, (before, after) in surgery.measures.items()),
        f"{'height gained [mm]':<32}{'':>9}{'':>9}{_change(surgery.height_gained):>9}",
        "",
        f"{'':<8}{'shift [mm]':>21}{'turn [°]':>24}{'against the one below [°]':>27}{'rotation [°]':>17}",
        f"{'level':<8}{'left':>7}{'back':>7}{'up':>7}{'tilt':>10}{'lean':>7}{'turn':>7}"
        f"{'tilt':>13}{'lean':>7}{'turn':>7}{'before':>10}{'after':>7}",
        *(_vertebra(vertebra) for vertebra in surgery.vertebrae),
        SIGNS,
        *(f"warning: {text}" for text in surgery.warnings),
    ]
    return "\n".join(lines)


def _measure(name: str, before: float, after: float) -> str:
    return f"{f'{name} [{unit_of(name)}]':<32}{before:>z9.1f}{after:>z9.1f}{_change(after - before):>9}"


def unit_of(name: str) -> str:
    """The unit of one of `PlannedSurgery.measures`."""
    return "°" if name.startswith(("kyphosis", "lordosis")) else "mm"


def surgery_record(surgery: PlannedSurgery) -> dict[str, Any]:
    """The same in plain JSON types; angles are in degrees, lengths in mm, pairs before and after."""
    return {
        "plan": dataclasses.asdict(surgery.plan),
        "curves": [dataclasses.asdict(curve) for curve in surgery.curves],
        "spine": surgery.measures,
        "height_gained": surgery.height_gained,
        "vertebrae": [dataclasses.asdict(vertebra) for vertebra in surgery.vertebrae],
        "warnings": list(surgery.warnings),
    }


def _curve(curve: CurveMotion) -> str:
    before, (turned, left) = curve.before, curve.rotation
    name = f"{before.upper}-{before.lower} {before.convex}{', planned' if curve.planned else ''}"
    corrected = f"{100.0 * (curve.cobb_after / before.angle - 1.0):+z.0f} %"
    bends = "" if curve.flexibility is None else f"{100.0 * curve.flexibility:.0f} %"
    cobb = f"{before.angle:.1f} to {curve.cobb_after:z.1f}"
    return f"{name:<24}{cobb:>16}{corrected:>8}{f'{turned:+z.1f} to {left:+z.1f}':>20}{bends:>11}"


def _vertebra(vertebra: VertebraMotion) -> str:
    before, after = vertebra.rotation
    name = f"{vertebra.level:<4}{'F' if vertebra.fused else '':<4}"
    moves = f"{_row(vertebra.shift, 7)}   {_row(vertebra.turn, 7)}      {_row(vertebra.segment, 7)}"
    return f"{name}{moves}{before:>z10.1f}{after:>z7.1f}"


def _row(values: Sequence[float], width: int) -> str:
    return "".join(f"{_change(value):>{width}}" for value in values)


def _change(value: float) -> str:
    return f"{value:+z.1f}"


def back_text(before: TrunkMeasures, after: TrunkMeasures) -> str:
    """The predicted change of the back: rotation, hump and shoulders before surgery and predicted."""
    shoulders = [None if one.shoulders is None else one.shoulders.difference for one in (before, after)]
    rows: list[tuple[str, float | None, float | None]] = [
        ("largest thoracic rotation [°]", before.max_thoracic_bsr, after.max_thoracic_bsr),
        ("largest lumbar rotation [°]", before.max_lumbar_bsr, after.max_lumbar_bsr),
        ("largest hump [mm]", before.max_hump, after.max_hump),
        ("right shoulder higher by [mm]", shoulders[0], shoulders[1]),
    ]
    lines = [f"{'back':<32}{'before':>9}{'predicted':>11}{'change':>9}"]
    for name, then, now in rows:
        told = ["missing" if value is None else _change(value) for value in (then, now)]
        change = "" if then is None or now is None else _change(now - then)
        lines.append(f"{name:<32}{told[0]:>9}{told[1]:>11}{change:>9}")
    return "\n".join(lines)
