"""A planned surgery: where the plan takes every vertebra, and what becomes of the spine; as text, too."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.measures import TrunkMeasures
from warp_trunk.measures.measures import measure_spine
from warp_trunk.measures.quantities import BEFORE, PREDICTED, MeasureTable
from warp_trunk.measures.rows import MeasureRow, as_text, skin_rows, spine_rows, under_headings
from warp_trunk.spine.cobb import CobbAngle

from .record import Plan
from .targets import curve_around

HELD, SET = "held by the plan", "set by the plan"
"""Words for numbers that follow from the plan alone, in place of an interval."""


def fixed_numbers(plan: Plan) -> dict[tuple[str, str], str]:
    """The numbers that a plan fixes whatever its curves ask for, by quantity and level: as they are before
    surgery (`HELD`), or at another value (`SET`)."""
    return {
        ("trunk_shift_mm", ""): HELD if plan.balance == "keep" else SET,
        ("trunk_shift_forward_mm", ""): HELD if plan.sva_after is None else SET,
        ("kyphosis_deg", "T5-T12"): HELD if plan.kyphosis_T5_T12 is None else SET,
        ("lordosis_deg", "L1-L5"): HELD if plan.lordosis_L1_L5 is None else SET,
    }


def planned_curves(plan: Plan, curves: Sequence[CobbAngle], levels: Sequence[str]) -> set[CobbAngle]:
    """The curves of a spine that a plan asks something of; the others follow.

    Args:
        plan: the plan.
        curves: those before surgery.
        levels: the vertebrae, top to bottom.
    """
    asked = (curve_around(curve.apex, curves, levels) for curve in plan.curves)
    return {curve for curve in asked if curve is not None}


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
    def rows(self) -> dict[str, list[MeasureRow]]:
        """The measures of the spine before and after, by heading."""
        before, after = (measure_spine(marks) for marks in (self.landmarks_before, self.landmarks_after))
        return spine_rows(MeasureTable.of({BEFORE: before, PREDICTED: after}), before)

    def planned_case(self, case: Case) -> Case:
        """The case with this surgery; what is known of another, actual one is left out."""
        return replace(case, landmarks_after=self.landmarks_after, actual_skin=None, bones_after={})


SIGNS = """\
F: fused. Shift of the centre to the left, to the back and up [mm]. Tilt to the left, lean to the back, turn with
the right side going back [°]; >: the same against the vertebra below. Rotation as `measure` has it [°]."""


def surgery_text(surgery: PlannedSurgery) -> str:
    """The planned change of the curves, the whole spine and each vertebra, and the warnings."""
    plan, planned = surgery.plan, ["left", "back", "up", "tilt", "lean", "turn", "> tilt", "> lean", "> turn"]
    spine = under_headings(surgery.rows, MeasureRow.compared_cells)
    vertebrae = [
        [f"{v.level:<4}{'F' * v.fused}", *(f"{x:+z.1f}" for x in (*v.shift, *v.turn, *v.segment))]
        + [f"{x:z.1f}" for x in v.rotation]
        for v in surgery.vertebrae
    ]
    bends = [
        f"curve {curve.before.upper} to {curve.before.lower}: bends out by {100.0 * curve.flexibility:.0f} %"
        for curve in surgery.curves
        if curve.flexibility is not None
    ]
    return "\n".join(
        [
            f"Fused {plan.uiv} to {plan.liv}, unfused segments {plan.unfused}",
            "",
            as_text(["measure", "before", "planned", "change"], spine),
            *bends,
            "",
            as_text(["level", *planned, "rotation before", "after"], vertebrae),
            SIGNS,
            *(f"warning: {text}" for text in surgery.warnings),
        ]
    )


def surgery_record(surgery: PlannedSurgery) -> dict[str, Any]:
    """The same in plain JSON types; angles are in degrees, lengths in mm, pairs before and after."""
    return {
        "plan": dataclasses.asdict(surgery.plan),
        "curves": [dataclasses.asdict(curve) for curve in surgery.curves],
        "spine": {row.name: row.values for row in surgery.rows.get("The spine as a whole", ())},
        "vertebrae": [dataclasses.asdict(vertebra) for vertebra in surgery.vertebrae],
        "warnings": list(surgery.warnings),
    }


def back_text(before: TrunkMeasures, after: TrunkMeasures) -> str:
    """The predicted change of the back: rotation, hump and shoulders before surgery and predicted."""
    table = MeasureTable.of({BEFORE: before, PREDICTED: after})
    rows = [row.compared_cells() for row in skin_rows(table)]
    return as_text(["back", "before", "predicted", "change"], rows)
