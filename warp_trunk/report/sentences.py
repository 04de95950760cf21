"""A result in words: sentences for the patient, the main numbers, and the options."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from warp_trunk.bone_motion.plan import Plan, fused_levels
from warp_trunk.measures import SkinComparison
from warp_trunk.measures.quantities import BEFORE, DETECTABLE, PREDICTED, QUANTITIES, Measured, MeasureTable
from warp_trunk.spine import CobbAngle

if TYPE_CHECKING:
    from warp_trunk.results.bands import Bands


MAIN = 0.8
"""A curve of at least this part of the largest is a main curve too: a double major has two."""
Pair = tuple[float | None, float | None]
"""A number before surgery and predicted."""


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
    table: MeasureTable,
    curves: Sequence[CobbAngle],
    comparison: SkinComparison | None = None,
    bands: Bands | None = None,
    plan: Plan | None = None,
) -> dict[str, str]:
    """Sentences on the plan, the changes, the rest and the certainty, by these headings.

    Args:
        table: the numbers of the result.
        curves: those of the spine before surgery.
        comparison: of the predicted skin with the actual one, where that is known.
        bands: the sources of the intervals, where there are some.
        plan: the plan that was simulated, where that is known.
    """
    followed = _followed(table, curves)
    sure = [band_sentence(table, bands), _trust(comparison)]
    return {
        "What is planned": _plan(followed),
        "What changes": " ".join(filter(None, [_change(table, len(_main(followed)) > 1), _bearing(table)])),
        "What stays": f"{_rest(table)} {_stiff(plan)}",
        "How sure this is": " ".join(sure),
    }


def pair(table: MeasureTable, key: str, level: str = "") -> Pair:
    """A number before surgery and predicted."""
    return table.value(BEFORE, key, level), table.value(PREDICTED, key, level)


def known(table: MeasureTable, key: str, level: str = "") -> tuple[float, float] | None:
    """A number before surgery and predicted, where both are known."""
    was, will = pair(table, key, level)
    return None if was is None or will is None else (was, will)


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
    "main_hump_mm": "on the {side}",
    "shoulder_difference_mm": "the {side} one higher",
    "waist_depth_mm": "the {side} one deeper",
    "trunk_shift_mm": "to the {side}",
}
"""Sides in words, by quantity."""


def glance(table: MeasureTable, curves: Sequence[CobbAngle]) -> list[Tile]:
    """The few numbers that a patient asks for first: before and after, with side and interval."""
    worst = table.largest(BEFORE, "bsr_deg") or ""  # the same one after surgery, where another may be the largest
    hump = table.place("main_hump_mm") or ""
    asked = [
        ("cobb_deg", f"curve of the spine, {_ends(curve)}, to the {curve.convex}", curve.ends)
        for curve, _ in _main(_followed(table, curves))
    ]
    asked += [
        ("bsr_deg", f"rotation of the back at {worst}", worst),
        ("main_hump_mm", f"hump at {hump}", hump),
        ("shoulder_difference_mm", "shoulders", ""),
        ("waist_depth_mm", "waist", ""),
        ("trunk_shift_mm", "top of the spine beside the pelvis", ""),
    ]
    tiles = []
    for key, name, level in asked:
        if both := known(table, key, level):
            tiles.append(_tile(key, name, *both, table.column(PREDICTED, key)[level]))
    if both := known(table, "spine_height_mm"):
        tiles.append(Tile("height of the spine", _minus(f"{both[1] - both[0]:+z.0f} mm"), "", ""))
    return tiles


def _tile(key: str, name: str, was: float, will: float, row: Measured) -> Tile:
    """A number before and after."""
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
    return Tile(
        name, _minus(value), _warning(was, will, quantity.detectable, flips), interval_text(row, sided=bool(words))
    )


def _warning(was: float, will: float, detectable: float, flips: bool) -> str:
    """A warning of another side, or of more than before; empty for neither."""
    more = abs(round(will)) - abs(round(was))
    words = ["changes its side"] if flips else []
    if more > 0:
        small = more < detectable
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


def band_sentence(table: MeasureTable, bands: Bands | None) -> str:
    """How sure the rotation at the level of the largest one is; states where that was not computed."""
    level = table.largest(BEFORE, "bsr_deg") or ""
    band = table.column(PREDICTED, "bsr_deg").get(level)
    if band is None or band.low is None or band.high is None:
        return "How far these numbers may be wrong was not computed for this prediction."
    least, most = sorted((abs(band.low), abs(band.high)))
    between = f"between {least:.0f} and {most:.0f} degrees"
    if round(band.low) * round(band.high) < 0:
        between = (
            f"between {abs(band.low):.0f} degrees with the left side further back and {band.high:.0f} with the "
            "right side"
        )
    nonlinear = bands is not None and ("bsr_deg", level) in bands.nonlinear
    rough = " That is a rough figure: small errors have uneven effects there." if nonlinear else ""
    return (
        f"In 19 of 20 such operations the rotation at {level} would be {between}, if the bones are seen and moved "
        f"as exactly as is usual.{rough}"
    )


Followed = Sequence[tuple[CobbAngle, float]]
"""Curves before surgery, each with the angle between the same vertebrae after it."""


def _followed(table: MeasureTable, curves: Sequence[CobbAngle]) -> Followed:
    after = table.values(PREDICTED, "cobb_deg")
    return [(curve, angle) for curve in curves if (angle := after.get(curve.ends)) is not None]


def _main(curves: Followed) -> Followed:
    """The curves that a spine is named after, top to bottom."""
    largest = max((curve.angle for curve, _ in curves), default=0.0)
    return [one for one in curves if one[0].angle >= MAIN * largest]


def _ends(curve: CobbAngle) -> str:
    return f"{curve.upper} to {curve.lower}"


def _minus(text: str) -> str:
    return text.replace("-", "−")


def _plan(curves: Followed) -> str:
    if not curves:
        return "The spine has no curve of 10 degrees or more."
    main = _main(curves)
    rest = [one for one in curves if one not in main]
    verb = "straighten" if all(abs(after) <= curve.angle for curve, after in curves) else "change"
    text = (
        f"The operation is planned to {verb} the main curve{'s' * (len(main) > 1)} of the spine {_listed(main)}."
    )
    if rest:
        verb = "s go" if len(rest) > 1 else " goes"
        text += f" The smaller curve{verb} {_listed(rest)}."
    return text


def _listed(curves: Followed) -> str:
    """The Cobb angles of each curve before and after."""
    each = [
        _minus(f"from {curve.angle:.0f} to {after:.0f} degrees ({_ends(curve)}, to the {curve.convex})")
        for curve, after in curves
    ]
    return listed(each)


def listed(words: Sequence[str]) -> str:
    """Words one after the other, the last two joined by "and"."""
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def _change(table: MeasureTable, several: bool) -> str:
    level = table.largest(BEFORE, "bsr_deg")
    was, will = pair(table, "bsr_deg", level or "")
    if level is None or was is None:
        return "The rotation of the back could not be measured."
    most = f"The rotation of the back is largest at vertebra {level}"
    if will is None:
        return f"{most}, {abs(was):.0f} degrees; the prediction could not be measured there."
    text = f"{most}: {abs(will):.0f} degrees are predicted there instead of {abs(was):.0f}"
    if was * will < 0.0 and abs(will) >= 0.5:
        text = (
            f"{most}: it is predicted to change from {abs(was):.0f} degrees with the {_side(was)} side further "
            f"back to {abs(will):.0f} degrees with the {_side(will)} side further back"
        )
    lower = table.place("lumbar_bsr_deg") or ""
    if several and level.startswith("T") and (lumbar := known(table, "lumbar_bsr_deg", lower)):
        text += f", and at {lower} in the lower back {abs(lumbar[1]):.0f} instead of {abs(lumbar[0]):.0f}"
    return f"{text}."


def _bearing(table: MeasureTable) -> str:
    """Shoulders, waist, balance and height; empty where none is known."""
    parts = []
    if shoulders := known(table, "shoulder_difference_mm"):
        was, will = map(_higher, shoulders)
        parts.append(f"the shoulders differ in height by {will} instead of {was}")
    left, right = known(table, "waist_depth_left_mm"), known(table, "waist_depth_right_mm")
    if left and right:
        was, will = map(_waist_height, pair(table, "waist_height_mm"))
        parts.append(
            f"the waist is {left[1]:.0f} mm deep on the left and {right[1]:.0f} on the right instead of "
            f"{left[0]:.0f} and {right[0]:.0f}, and {will} instead of {was}"
        )
    if shift := known(table, "trunk_shift_mm"):
        was, will = map(_beside, shift)
        parts.append(f"the top of the spine stands {will} instead of {was}")
    if (height := known(table, "spine_height_mm")) and abs(gained := height[1] - height[0]) >= 0.5:
        parts.append(f"the spine is {abs(gained):.0f} mm {'taller' if gained > 0.0 else 'shorter'}")
    return " ".join(f"{part[:1].upper()}{part[1:]}." for part in parts)


def _waist_height(height: float | None) -> str:
    if height is None or abs(height) < 0.5:
        return "level"
    return f"{abs(height):.0f} mm higher on the {_side(height)}"


def _beside(shift: float) -> str:
    place = "over the middle of the pelvis"
    return place if abs(shift) < 0.5 else f"{abs(shift):.0f} mm to the {_side(shift)} of the middle of the pelvis"


def _higher(difference: float) -> str:
    side = "" if abs(difference) < 0.5 else f" (the {_side(difference)} one higher)"
    return f"{abs(difference):.0f} mm{side}"


def _rest(table: MeasureTable) -> str:
    level = table.largest(PREDICTED, "bsr_deg")
    was, angle = pair(table, "bsr_deg", level or "")
    if level is None or angle is None:
        return "The rotation of the predicted back could not be measured."
    if abs(angle) < DETECTABLE:
        return (
            f"The predicted rotation of the back is below {DETECTABLE:g} degrees at every vertebra, the smallest "
            "difference that such measurements can detect."
        )
    place = table.place("main_hump_mm") or ""
    hump = known(table, "main_hump_mm", place)
    verb = "still stands" if was is not None and abs(was) >= 0.5 and was * angle > 0.0 else "then stands"
    text = (
        f"The {_side(angle)} side of the back {verb} further back, by {abs(angle):.0f} degrees at vertebra {level}"
    )
    if hump is None:
        return f"{text}."
    sizes, sides = [f"{abs(size):.0f}" for size in hump], [_side(size) for size in hump]
    more = table.elsewhere(PREDICTED, "main_hump_mm")
    now = "" if more is None else f"; it is then largest at {more.level}, {abs(more.value or 0.0):.0f} mm"
    return f"{text}; the hump at {place} is {sizes[1]} mm ({sides[1]}) instead of {sizes[0]} ({sides[0]}){now}."


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


UNITS = {
    "bone_margin": "mm",
    "bone_voxel": "mm",
    "bone_edge_length": "mm",
    "bone_tolerance": "mm",
    "tolerance": "mm",
    "gravity": "m/s^2",
    "skin_rigidity": "N mm",
    "density": "kg/m^3",
    "youngs_modulus": "kPa",
}
"""Units of options by name, as their documentation has them; all others have none."""
_SHOWN = {"m/s^2": "m/s²", "kg/m^3": "kg/m³", "degrees": "°"}


def option_rows(parameters: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Each option in words, as on the command line but for its dashes, with its value and unit."""
    return [(name.replace("_", " "), value_text(value, UNITS.get(name, ""))) for name, value in parameters.items()]


def value_text(value: object, unit: str = "") -> str:
    """A value as text, with its unit; a dash for none."""
    if value is None or value == []:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(map(str, value))
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"{text} {_SHOWN.get(unit, unit)}".rstrip()
