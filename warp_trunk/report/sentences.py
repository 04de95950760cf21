"""A result in words: sentences for the patient, questions to ask, and the options."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from warp_trunk.bone_motion.plan import Plan, fused_levels, planned_curves
from warp_trunk.checking import units_of
from warp_trunk.engine.relaxation import RelaxOptions
from warp_trunk.engine.tissue import GRAVITY_LIMITS, RIGIDITY_LIMITS, Tissue
from warp_trunk.measures import SkinComparison
from warp_trunk.measures.levels import largest_at
from warp_trunk.measures.number_text import sided
from warp_trunk.measures.quantities import (
    BEFORE,
    DETECTABLE,
    PREDICTED,
    QUANTITIES,
    Measured,
    MeasureTable,
)
from warp_trunk.measures.scoliometer import BENT, BENT_SD
from warp_trunk.measures.verdicts import NOT_KNOWN, is_known
from warp_trunk.meshing import MeshOptions
from warp_trunk.results.bands import Bands
from warp_trunk.spine import CobbAngle

from .headlines import ELSEWHERE, Headline, minus, side_of

_WORDS = {
    "visibly better": "Visibly better",
    ELSEWHERE: "Worse at another level",
    "no visible change": "No visible change",
    "other side": "On the other side",
    "visibly worse": "Visibly worse",
    NOT_KNOWN: "Not known",
}
"""How each word of a headline begins its part of a sentence, in the order in which they are named."""
_SUBJECTS = {
    "waist_height_mm": "height of the waist",
    "waist_depth_mm": "depth of the waist",
    "main_hump_mm": "hump",
    "shoulder_difference_mm": "shoulders",
    "trunk_shift_mm": "balance to the side",
    "bsr_deg": "rotation of the back",
}
"""Headlines by a noun."""


def sentences(
    table: MeasureTable,
    shown: Sequence[Headline],
    comparison: SkinComparison | None = None,
    bands: Bands | None = None,
    plan: Plan | None = None,
) -> dict[str, str]:
    """Sentences on the changes, the likely range and the rest, by these headings; without an angle of the spine.

    Args:
        table: the numbers of the result.
        shown: those that a patient asks for first.
        comparison: of the predicted skin with the actual one, where that is known.
        bands: the sources of the intervals, where there are some.
        plan: the plan that was simulated; None without a fusion.
    """
    return {
        "What changes": " ".join(filter(None, (_groups(shown), _waist_and_hump(shown), _upright(shown)))),
        "The likely range": f"{band_sentence(table, bands)} {_trust(comparison)}",
        "What will not change": " ".join(filter(None, (_rest(table), stiff(plan)))),
    }


def questions(shown: Sequence[Headline], plan: Plan | None) -> list[str]:
    """Questions that a patient may ask her surgeon about this prediction."""
    named = {headline.word: _SUBJECTS[headline.key] for headline in reversed(shown) if headline.key in _SUBJECTS}
    asked = []
    if worse := named.get("visibly worse") or named.get(ELSEWHERE):
        asked.append(f"The {worse} may look worse than now. Would another plan avoid that?")
    if unsure := named.get(NOT_KNOWN):
        asked.append(f"It is not known how the {unsure} will look. What have you seen in others?")
    asked.append("What would my back look like without surgery, or with fewer vertebrae joined?")
    if plan is not None:
        asked.append("What will I no longer be able to do with the joined vertebrae?")
    return [*asked, "How far may the result be from these pictures?"]


def joined_sentence(plan: Plan | None) -> str:
    """The fused vertebrae in a sentence."""
    if plan is None:
        return "The bones were moved without a plan of fusion: no vertebra is stated to be joined."
    return f"The {len(fused_levels(plan))} vertebrae from {plan.uiv} to {plan.liv} are joined by rods, for good."


def stiff(plan: Plan | None) -> str:
    """Scar and stiffness; empty without a fusion."""
    if plan is None:
        return ""
    where = f"A scar runs along the vertebrae from {plan.uiv} to {plan.liv}"
    return f"{where}. There the spine no longer bends or turns; above and below it still does."


def planned(
    table: MeasureTable, curves: Sequence[CobbAngle], levels: Sequence[str], plan: Plan | None, lenke: str = ""
) -> str:
    """The change of the curves, for the surgeon: those that the plan asks something of, then those that follow.

    Args:
        table: the numbers of the result.
        curves: those before surgery.
        levels: the vertebrae, top to bottom.
        plan: the plan; without one, curves go with the bones.
        lenke: curve type by Lenke; empty where there is none.
    """
    kind = [f"The curve type is Lenke {lenke}."] if lenke else []
    after = table.column(PREDICTED, "cobb_deg")
    followed = [(curve, row) for curve in curves if (row := after.get(curve.ends)) is not None]
    if not followed:
        return "The spine has no curve of 10 degrees or more."
    if plan is None:
        return " ".join([*kind, f"The curves of the spine go {_listed(followed)}."])
    asked, texts = planned_curves(plan, curves, levels), kind
    for of_plan, text in ((True, "The plan takes the curve{s} {}."), (False, "The other curve{s} follow{v}: {}.")):
        if some := [followed_curve for followed_curve in followed if (followed_curve[0] in asked) == of_plan]:
            several = len(some) > 1
            texts.append(text.format(_listed(some), s="s" * several, v="" if several else "s"))
    return " ".join(texts)


def bent(table: MeasureTable) -> str:
    """The reading of a scoliometer in the forward bend, where it is largest before, for the surgeon; empty where
    it is not known."""
    level = largest_at(table.values(BEFORE, "forward_bend_deg"), tuple(BENT))
    before, after = (
        None if level is None else table.row(state, "forward_bend_deg", level) for state in (BEFORE, PREDICTED)
    )
    if before is None or before.value is None or after is None or after.value is None:
        return ""
    sd, quantity = BENT_SD if math.isnan(after.sd) else after.sd, QUANTITIES["forward_bend_deg"]
    row = Measured.with_sd(PREDICTED, after.level, after.quantity, after.value, sd)
    was, will = (sided(value, "°") for value in (before.value, after.value))
    likely = f"{sided(row.low, '°')} to {sided(row.high, '°')} in 95 % of patients"
    if is_known(quantity, row, before.value):
        return f"A scoliometer at {level} in the forward bend would show about {will} instead of {was}: {likely}."
    return f"What a scoliometer at {level} would show in the forward bend is not known, {was} before: {likely}."


def band_sentence(table: MeasureTable, bands: Bands | None) -> str:
    """How sure the main hump is, or else the largest rotation; states where that was not computed."""
    hump, turned = table.place("main_hump_mm") or "", table.largest(BEFORE, "bsr_deg") or ""
    for key, level, what, unit in (
        ("main_hump_mm", hump, f"hump at {hump}", "mm"),
        ("bsr_deg", turned, f"rotation at {turned}", "degrees"),
    ):
        band, before = table.row(PREDICTED, key, level), table.value(BEFORE, key, level)
        if band is None or band.low is None or band.high is None or not is_known(QUANTITIES[key], band, before):
            continue
        least, most = sorted((abs(band.low), abs(band.high)))
        between = f"between {least:.0f} and {most:.0f} {unit}"
        if round(band.low) * round(band.high) < 0:
            between = (
                f"between {abs(band.low):.0f} {unit} with the left side further back and {band.high:.0f} with the "
                "right side"
            )
        nonlinear = bands is not None and (key, level) in bands.nonlinear
        rough = " That is a rough figure: small errors have uneven effects there." if nonlinear else ""
        usual = "if the bones are seen and moved as exactly as is usual"
        return f"In 19 of 20 such operations the {what} would be {between}, {usual}.{rough}"
    if any(row.low is not None for row in table.column(PREDICTED, "bsr_deg").values()):
        return "The hump and the rotation of the back are not known well enough for a likely range."
    return "How far these numbers may be wrong was not computed for this prediction."


def _listed(curves: Sequence[tuple[CobbAngle, Measured]]) -> str:
    """The Cobb angles of each curve before and after."""
    each = []
    for curve, after in curves:
        is_sure = after.value is not None and is_known(QUANTITIES["cobb_deg"], after, curve.angle)
        size = f"to {after.value:.0f} degrees" if is_sure else f"degrees to an angle that is {NOT_KNOWN}"
        each.append(f"from {curve.angle:.0f} {size} ({curve.upper} to {curve.lower}, to the {curve.convex})")
    return minus(listed(each))


def listed(words: Sequence[str]) -> str:
    """Words one after the other, the last two joined by "and"."""
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def _groups(shown: Sequence[Headline]) -> str:
    """The headlines of the back by their word, in one sentence."""
    parts = []
    for word, text in _WORDS.items():
        nouns = [_SUBJECTS[line.key] for line in shown if line.word == word and line.key in _SUBJECTS]
        parts += [f"{text.lower() if parts else text}: {listed(nouns)}"] if nouns else []
    return f"{'; '.join(parts)}." if parts else "The back could not be measured."


def _waist_and_hump(shown: Sequence[Headline]) -> str:
    """The change of waist and hump, as far as that is known."""
    by_key = {line.key: line for line in shown if line.is_known}
    parts = []
    for key, words in (("waist_height_mm", "higher"), ("waist_depth_mm", "deeper")):
        if line := by_key.get(key):
            parts.append(f"{_more(line.value, words)} instead of {_more(line.before, words)}")
    text = [f"the waist is {listed(parts)}"] if parts else []
    if hump := by_key.get("main_hump_mm"):
        now, before = map(_on_side, (hump.value, hump.before))
        larger = f", {hump.note}" if hump.note else ""
        text.append(f"the hump at {hump.level} is {now} instead of {before}{larger}")
    return _sentence(text)


def _upright(shown: Sequence[Headline]) -> str:
    """The change of shoulders and balance, as far as that is known."""
    by_key = {line.key: line for line in shown if line.is_known}
    text = []
    if line := by_key.get("shoulder_difference_mm"):
        text.append(f"the shoulders differ in height by {_higher(line.value)} instead of {_higher(line.before)}")
    if line := by_key.get("trunk_shift_mm"):
        place = _beside(line.value)
        same = line.fixed and round(line.value) == round(line.before)
        text.append(
            f"the top of the spine stays {place}, {line.fixed}" if same
            else f"the top of the spine stands {place} instead of {_beside(line.before)}"
        )  # fmt: skip
    return _sentence(text)


def _sentence(parts: Sequence[str]) -> str:
    text = "; ".join(parts)
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def _more(difference: float, words: str) -> str:
    """A difference of the sides of the waist."""
    if abs(difference) < 0.5:
        return "level" if words == "higher" else "as deep on both sides"
    return f"{abs(difference):.0f} mm {words} on the {side_of(difference)}"


def _on_side(size: float) -> str:
    """A size with its side in brackets."""
    return f"{abs(size):.0f} mm" + (f" ({side_of(size)})" if abs(size) >= 0.5 else "")


def _beside(shift: float) -> str:
    middle = "the middle of the pelvis"
    return f"over {middle}" if abs(shift) < 0.5 else f"{abs(shift):.0f} mm to the {side_of(shift)} of {middle}"


def _higher(difference: float) -> str:
    side = "" if abs(difference) < 0.5 else f" (the {side_of(difference)} one higher)"
    return f"{abs(difference):.0f} mm{side}"


def _rest(table: MeasureTable) -> str:
    """The rotation that is left."""
    level = table.largest(PREDICTED, "bsr_deg") or ""
    row, was = table.row(PREDICTED, "bsr_deg", level), table.value(BEFORE, "bsr_deg", level)
    if row is None or row.value is None:
        return "The rotation of the predicted back could not be measured."
    if not is_known(QUANTITIES["bsr_deg"], row, was):
        return "How far the back is still turned is not known."
    if abs(row.value) < DETECTABLE:
        return (
            f"The predicted rotation of the back is below {DETECTABLE:g} degrees at every vertebra from T3 down, "
            "the smallest difference that such measurements can detect."
        )
    verb = "still stands" if was is not None and abs(was) >= 0.5 and was * row.value > 0.0 else "then stands"
    size = f"{abs(row.value):.0f} degrees at vertebra {level}"
    return f"The {side_of(row.value)} side of the back {verb} further back, by {size}."


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


UNITS = {
    **units_of(MeshOptions),
    **units_of(RelaxOptions),
    **units_of(Tissue),
    "gravity": GRAVITY_LIMITS.description,
    "skin_rigidity": RIGIDITY_LIMITS.description,
}
"""Units of options by name; all others have none."""
_SHOWN = {"m/s^2": "m/s²", "kg/m^3": "kg/m³", "degrees": "°"}


def option_rows(parameters: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Each option in words, as on the command line but for its dashes, with its value and unit."""
    return [
        (name.replace("_", " "), option_text(value, UNITS.get(name, ""))) for name, value in parameters.items()
    ]


def option_text(value: object, unit: str = "") -> str:
    """A value as text, with its unit; a dash for none."""
    if value is None or value == []:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(map(str, value))
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"{text} {_SHOWN.get(unit, unit)}".rstrip()
