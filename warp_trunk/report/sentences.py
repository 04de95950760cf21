"""The meaning of a result in a few plain sentences for the patient, and the main numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from warp_trunk.bone_motion.plan import Plan, fused_levels
from warp_trunk.measures import SkinComparison, TrunkMeasures
from warp_trunk.measures.followed_curves import FollowedCurve, followed_curves, main_curves
from warp_trunk.measures.quantities import DETECTABLE, PREDICTED, QUANTITIES, Measured, MeasureTable, Quantity
from warp_trunk.measures.waist import Waist

from .style import TrunkState

if TYPE_CHECKING:
    from warp_trunk.results import Summary


@dataclass(frozen=True)
class Tile:
    """One of the numbers that a patient asks for first."""

    name: str
    """The quantity, with its side where it keeps one."""
    value: str
    """Before surgery and predicted."""
    warning: str
    """Whether it grows or changes its side; empty where it does not."""
    interval: str
    """Where the predicted number lies in 19 of 20 cases; empty where that was not computed."""


def sentences(
    poses: Sequence[TrunkState],
    comparison: SkinComparison | None,
    summary: Summary | None = None,
    plan: Plan | None = None,
) -> dict[str, str]:
    """Sentences on the plan, the changes, the rest and the certainty, by these headings.

    Args:
        poses: before surgery and predicted.
        comparison: of the predicted skin with the actual one, where that is known.
        summary: of the result, with its intervals where it has them.
        plan: the plan that was simulated, where that is known.
    """
    before, predicted = poses[0].measures, poses[1].measures
    curves = _known_curves(before, predicted)
    several = len(main_curves(curves)) > 1
    sure = ["" if summary is None else band_sentence(summary, before.worst_level or ""), _trust(comparison)]
    return {
        "What is planned": _plan(curves),
        "What changes": " ".join(filter(None, [_change(before, predicted, several), _bearing(before, predicted)])),
        "What stays": f"{_rest(before, predicted)} {_stiff(plan)}",
        "How sure this is": " ".join(filter(None, sure)),
    }


def joined(plan: Plan | None) -> str:
    """The fused vertebrae in a sentence."""
    if plan is None:
        return "The plan does not state which vertebrae are joined."
    return f"The {len(fused_levels(plan))} vertebrae from {plan.uiv} to {plan.liv} are joined by rods, for good."


def _stiff(plan: Plan | None) -> str:
    where = "the joined vertebrae" if plan is None else f"the vertebrae from {plan.uiv} to {plan.liv}"
    return f"A scar runs along {where}. There the spine no longer bends or turns; above and below it still does."


_SIDES = {
    "bsr_deg": "the {side} side further back",
    "max_hump_mm": "on the {side}",
    "shoulder_difference_mm": "the {side} one higher",
    "waist_depth_mm": "the {side} one deeper",
    "trunk_shift_mm": "to the {side}",
}
"""Sides in words, by quantity."""


def glance(poses: Sequence[TrunkState], summary: Summary | None = None) -> list[Tile]:
    """The few numbers that a patient asks for first: before and after, with side and interval."""
    before, predicted = poses[0].measures, poses[1].measures
    table = MeasureTable([] if summary is None else summary.measures)
    tiles = []
    for curve in main_curves(_known_curves(before, predicted)):
        level = f"{curve.before.upper}-{curve.before.lower}"
        name = f"curve of the spine, {curve.ends}, to the {curve.before.convex}"
        row = table.column(PREDICTED, "cobb_deg").get(level)
        tiles.append(_tile("cobb_deg", name, curve.before.angle, curve.angle_after, row))
    worst = before.worst_level  # the same one after surgery, where another may be the largest
    for key, name, level, pair in (
        ("bsr_deg", f"rotation of the back at {worst}", worst or "", _rotations(before, predicted)),
        ("max_hump_mm", "hump", "", (before.max_hump, predicted.max_hump)),
        ("shoulder_difference_mm", "shoulders", "", (_shoulders(before), _shoulders(predicted))),
        ("waist_depth_mm", "waist", "", (_waist(before), _waist(predicted))),
        ("trunk_shift_mm", "top of the spine beside the pelvis", "", (_shift(before), _shift(predicted))),
    ):
        was, will = pair
        if was is not None and will is not None:
            tiles.append(_tile(key, name, was, will, table.column(PREDICTED, key).get(level)))
    gained = _height_gained(before, predicted)
    if gained is not None:
        tiles.append(Tile("height of the spine", _minus(f"{gained:+z.0f} mm"), "", ""))
    return tiles


def _tile(key: str, name: str, was: float, will: float | None, row: Measured | None) -> Tile:
    """A number before and after; `will` is known."""
    assert will is not None
    quantity, words = QUANTITIES[key], _SIDES.get(key)
    unit = "°" if quantity.unit == "°" else " mm"
    sides = [_side(value) if round(value) else "" for value in (was, will)]
    flips = bool(words) and sides[0] != sides[1] and "" not in sides
    if words and not flips and (side := sides[0] or sides[1]):
        name = f"{name}, {words.format(side=side)}"
    first, last = (f"{abs(was):.0f}", f"{abs(will):.0f}") if words else (f"{was:.0f}", f"{will:.0f}")
    value = f"{first} → {last}{unit}"
    if flips:
        value = f"{first} {sides[0]} → {last} {sides[1]}{unit if unit == '°' else ''}"
        name += "" if unit == "°" else " [mm]"
    return Tile(name, _minus(value), _warning(quantity, was, will, flips), interval_text(row, sided=bool(words)))


def _warning(quantity: Quantity, was: float, will: float, flips: bool) -> str:
    """A warning of another side, or of more than before; empty for neither."""
    more = abs(round(will)) - abs(round(was))
    words = ["changes its side"] if flips else []
    if more > 0:
        small = more < quantity.detectable
        words.append("more than before" + (", but hardly to be seen" if small else ""))
    return " and ".join(words)


def interval_text(row: Measured | None, *, sided: bool) -> str:
    """Where a number lies in 19 of 20 cases; empty where that is not known."""
    if row is None or row.low is None or row.high is None:
        return ""
    low, high = row.low, row.high
    if round(low) * round(high) >= 0 or not sided:
        ends = sorted((abs(low), abs(high))) if sided else [low, high]
        return _minus(f"{ends[0]:z.0f} to {ends[1]:z.0f}")
    return f"{abs(low):.0f} left to {high:.0f} right"


def band_sentence(summary: Summary, level: str) -> str:
    """How sure the rotation at a level is; states where that was not computed."""
    band = MeasureTable(summary.measures).column(PREDICTED, "bsr_deg").get(level)
    if band is None or band.low is None or band.high is None:
        return "How far these numbers may be wrong was not computed for this prediction."
    nonlinear = summary.bands is not None and ("bsr_deg", level) in summary.bands.nonlinear
    least, most = sorted((abs(band.low), abs(band.high)))
    between = f"between {least:.0f} and {most:.0f} degrees"
    if round(band.low) * round(band.high) < 0:
        between = (
            f"between {abs(band.low):.0f} degrees with the left side further back and {band.high:.0f} with the "
            "right side"
        )
    rough = " That is a rough figure: small errors have uneven effects there." if nonlinear else ""
    return (
        f"In 19 of 20 such operations the rotation at {level} would be {between}, if the bones are seen and moved "
        f"as exactly as is usual.{rough}"
    )


def _known_curves(before: TrunkMeasures, after: TrunkMeasures) -> list[FollowedCurve]:
    return [curve for curve in followed_curves(before, after) if curve.angle_after is not None]


def _rotations(before: TrunkMeasures, after: TrunkMeasures) -> tuple[float | None, float | None]:
    """The rotation of the back before and after, both at the level where it is largest before."""
    level = before.worst_level
    return (None, None) if level is None else (before.bsr[level], after.bsr.get(level))


def _height_gained(before: TrunkMeasures, after: TrunkMeasures) -> float | None:
    was, will = before.spine_height, after.spine_height
    return None if was is None or will is None else will.height - was.height


def _shoulders(measures: TrunkMeasures) -> float | None:
    return measures.shoulders and measures.shoulders.difference


def _waist(measures: TrunkMeasures) -> float | None:
    return measures.waist and measures.waist.depth_difference


def _shift(measures: TrunkMeasures) -> float | None:
    return measures.trunk_shift and measures.trunk_shift.lateral


def _minus(text: str) -> str:
    return text.replace("-", "−")


def _plan(curves: Sequence[FollowedCurve]) -> str:
    if not curves:
        return "The spine has no curve of 10 degrees or more."
    main = main_curves(curves)
    rest = [curve for curve in curves if curve not in main]
    verb = "straighten" if all(abs(c.angle_after or 0.0) <= c.before.angle for c in curves) else "change"
    text = (
        f"The operation is planned to {verb} the main curve{'s' * (len(main) > 1)} of the spine {_listed(main)}."
    )
    if rest:
        verb = "s go" if len(rest) > 1 else " goes"
        text += f" The smaller curve{verb} {_listed(rest)}."
    return text


def _listed(curves: Sequence[FollowedCurve]) -> str:
    """The Cobb angles of each curve before and after."""
    each = [
        _minus(f"from {c.before.angle:.0f} to {c.angle_after:.0f} degrees ({c.ends}, to the {c.before.convex})")
        for c in curves
    ]
    return listed(each)


def listed(words: Sequence[str]) -> str:
    """Words one after the other, the last two joined by "and"."""
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def _change(before: TrunkMeasures, predicted: TrunkMeasures, several: bool) -> str:
    was, will = _rotations(before, predicted)
    if was is None:
        return "The rotation of the back could not be measured."
    most = f"The rotation of the back is largest at vertebra {before.worst_level}"
    if will is None:
        return f"{most}, {abs(was):.0f} degrees; the prediction could not be measured there."
    text = f"{most}: {abs(will):.0f} degrees are predicted there instead of {abs(was):.0f}"
    if was * will < 0.0 and abs(will) >= 0.5:
        text = (
            f"{most}: it is predicted to change from {abs(was):.0f} degrees with the {_side(was)} side further "
            f"back to {abs(will):.0f} degrees with the {_side(will)} side further back"
        )
    lumbar, after = before.max_lumbar_bsr, predicted.max_lumbar_bsr
    if several and str(before.worst_level).startswith("T") and lumbar is not None and after is not None:
        text += f", and in the lower back {abs(after):.0f} instead of {abs(lumbar):.0f}"
    return f"{text}."


def _bearing(before: TrunkMeasures, predicted: TrunkMeasures) -> str:
    """Shoulders, waist, balance and height; empty where none is known."""
    parts = []
    was, will = _shoulders(before), _shoulders(predicted)
    if was is not None and will is not None:
        parts.append(f"the shoulders differ in height by {_higher(will)} instead of {_higher(was)}")
    if before.waist is not None and predicted.waist is not None:
        was, will = before.waist, predicted.waist
        parts.append(
            f"the waist is {will.left_depth:.0f} mm deep on the left and {will.right_depth:.0f} on the right "
            f"instead of {was.left_depth:.0f} and {was.right_depth:.0f}, and {_waist_height(will)} instead of "
            f"{_waist_height(was)}"
        )
    was, will = _shift(before), _shift(predicted)
    if was is not None and will is not None:
        parts.append(f"the top of the spine stands {_beside(will)} instead of {_beside(was)}")
    gained = _height_gained(before, predicted)
    if gained is not None and abs(gained) >= 0.5:
        parts.append(f"the spine is {abs(gained):.0f} mm {'taller' if gained > 0.0 else 'shorter'}")
    return " ".join(f"{part[:1].upper()}{part[1:]}." for part in parts)


def _waist_height(waist: Waist) -> str:
    height = waist.height_difference
    return "level" if abs(height) < 0.5 else f"{abs(height):.0f} mm higher on the {_side(height)}"


def _beside(shift: float) -> str:
    place = "over the middle of the pelvis"
    return place if abs(shift) < 0.5 else f"{abs(shift):.0f} mm to the {_side(shift)} of the middle of the pelvis"


def _higher(difference: float) -> str:
    side = "" if abs(difference) < 0.5 else f" (the {_side(difference)} one higher)"
    return f"{abs(difference):.0f} mm{side}"


def _rest(before: TrunkMeasures, predicted: TrunkMeasures) -> str:
    level = predicted.worst_level
    angle = predicted.bsr.get(level or "")
    if level is None or angle is None:
        return "The rotation of the predicted back could not be measured."
    if abs(angle) < DETECTABLE:
        return (
            f"The predicted rotation of the back is below {DETECTABLE:g} degrees at every vertebra, the smallest "
            "difference that such measurements can detect."
        )
    was, hump, will = before.bsr.get(level), before.max_hump, predicted.max_hump
    verb = "still stands" if was is not None and abs(was) >= 0.5 and was * angle > 0.0 else "then stands"
    text = (
        f"The {_side(angle)} side of the back {verb} further back, by {abs(angle):.0f} degrees at vertebra {level}"
    )
    if hump is None or will is None:
        return f"{text}."
    after, before_it = f"{abs(will):.0f} mm ({_side(will)})", f"{abs(hump):.0f} ({_side(hump)})"
    return f"{text}; the largest hump is {after} instead of {before_it}."


def _trust(comparison: SkinComparison | None) -> str:
    own = "the real back can turn out differently"
    if comparison is None:
        return f"This is a computer simulation for research. It has not been compared with patients: {own}."
    error = comparison.bsr_error["T3-L5"]
    if error is None:
        return f"The prediction could not be compared with the actual back after surgery: {own}."
    within = "less" if error.undetectable else "no less"
    return (
        f"Compared with the actual back after surgery, the error of the predicted rotation is {error.mean:.1f} "
        f"degrees on average, {within} than the {DETECTABLE:g} degrees that such measurements can detect. "
        "One comparison says nothing about other patients."
    )


def _side(angle: float) -> str:
    return "right" if angle > 0.0 else "left"
