"""A planned surgery as a table for a terminal, and as plain JSON types."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    from warp_trunk.measures import TrunkMeasures

    from .surgery import CurveMotion, PlannedSurgery, VertebraMotion

SIGNS = """\
F: fused. Shift of the centre to the left, to the back and up. Tilt to the left, lean to the back, turn with the
right side going back; the same against the vertebra below. Rotation as `measure` has it."""


def surgery_text(surgery: PlannedSurgery) -> str:
    """What a plan asks of the curves, of the whole spine and of each vertebra, and what to look at."""
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
    """What becomes of the back: rotation, hump and shoulders before surgery and predicted."""
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
