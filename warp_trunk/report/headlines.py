"""The few numbers that a patient asks for first, in the order in which patients rank them, each with one word."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from warp_trunk.measures.number_text import interval_text
from warp_trunk.measures.quantities import QUANTITIES, Measured, MeasureTable, Quantity
from warp_trunk.measures.rows import STATES
from warp_trunk.measures.verdicts import NOT_KNOWN, is_certainly_worse, is_known, verdict
from warp_trunk.spine import CobbAngle

ELSEWHERE = "worse elsewhere"
"""The word where the largest of a state is at another level and visibly larger than the largest before surgery."""
MAIN = 0.8
"""A curve of at least this part of the largest is a main curve too: a double major has two."""
_NAMES = {
    "waist_height_mm": ("waist, height", "the {side} one higher"),
    "waist_depth_mm": ("waist, depth", "the {side} one deeper"),
    "main_hump_mm": ("hump at {level}", "on the {side}"),
    "shoulder_difference_mm": ("shoulders", "the {side} one higher"),
    "trunk_shift_mm": ("top of the spine beside the pelvis", "to the {side}"),
    "bsr_deg": ("rotation of the back at {level}", "the {side} side further back"),
    "cobb_deg": ("curve of the spine, {ends}", ""),
    "spine_height_mm": ("height of the spine", ""),
}
"""Names for a patient, and their side in words, in the order in which they are shown."""


@dataclass(frozen=True)
class Headline:
    """A number before surgery and in another state."""

    quantity: Quantity
    """The quantity."""
    before: float
    """Its value before surgery."""
    after: Measured
    """Its row in the other state."""
    larger: Measured | None = None
    """Where the other state has more than at this place; None where it has not."""
    fixed: str = ""
    """Words in place of a verdict and an interval, where the plan fixes it."""

    @property
    def key(self) -> str:
        """The key of its quantity."""
        return self.quantity.key

    @property
    def level(self) -> str:
        """Where it is measured."""
        return self.after.level

    @property
    def value(self) -> float:
        """Its value in the other state; 0 where it is missing."""
        return self.after.value or 0.0

    @property
    def is_known(self) -> bool:
        """Whether its interval is narrower than what it says, or the plan fixes it."""
        return bool(self.fixed) or is_known(self.quantity, self._said, self._was)

    @property
    def word(self) -> str:
        """The word for its change; empty for a number that need not be small."""
        word = self.fixed or verdict(self.quantity, self.before, self.after) or ""
        if self.larger is None or self.larger.value is None or not self.is_known or self.fixed:
            return word
        grown = abs(self.larger.value) - abs(self.before)  # elsewhere, beyond the largest before surgery
        return word if grown < self.quantity.detectable else ELSEWHERE

    @property
    def is_worse(self) -> bool:
        """Whether it is visibly worse, and certainly so."""
        return not self.fixed and is_certainly_worse(self.quantity, self.before, self.after)

    @property
    def changes_side(self) -> bool:
        """Whether both numbers, as they are shown, are on different sides."""
        return self.quantity.side and round(self.before) * round(self.value) < 0

    @property
    def subject(self) -> str:
        """Its name for a patient."""
        return _NAMES[self.key][0].format(level=self.level, ends=self.level.replace("-", " to "))

    @property
    def side(self) -> str:
        """Its side in words; empty where it has none, or changes it."""
        words, numbers = _NAMES[self.key][1], (self.before, self.value) if self.is_known else (self.before,)
        side = next((side_of(number) for number in numbers if round(number)), "")
        return words.format(side=side) if words and side and not self.changes_side else ""

    @property
    def name(self) -> str:
        """Its name for a patient, with its side where it keeps one."""
        return ", ".join(filter(None, (self.subject, self.side)))

    @property
    def text(self) -> str:
        """Before surgery and in the other state, in whole units."""
        unit = "°" if self.quantity.unit == "°" else " mm"
        if not self.is_known:
            return NOT_KNOWN
        if self.key == "spine_height_mm":
            return minus(f"{self.value - self.before:+z.0f}{unit}")
        was, will = ((abs(n) if self.quantity.side else n) for n in (self.before, self.value))
        if self.changes_side:
            return f"{was:.0f}{unit} {side_of(self.before)} → {will:.0f}{unit} {side_of(self.value)}"
        if self.fixed and round(was) == round(will):
            return minus(f"{will:.0f}{unit}")
        return minus(f"{was:.0f} → {will:.0f}{unit}")

    @property
    def interval(self) -> str:
        """Where it lies in 19 of 20 cases; empty where that is not known or the plan fixes it."""
        return "" if self.fixed else interval_text(self._said, sided=self.quantity.side)

    @property
    def _was(self) -> float | None:
        """The number that it is compared with; None for a gain."""
        return None if self.key == "spine_height_mm" else self.before

    @property
    def _said(self) -> Measured:
        """The row that is shown: of the height what is gained."""
        if self.key != "spine_height_mm":
            return self.after
        ends = (self.after.low, self.after.value, self.after.high)
        low, value, high = (None if end is None else end - self.before for end in ends)
        return replace(self.after, low=low, value=value, high=high)

    @property
    def note(self) -> str:
        """Where the other state has more; empty where it has not."""
        if self.larger is None or self.larger.value is None or not self.is_known:
            return ""
        unit = "°" if self.quantity.unit == "°" else " mm"
        return f"now largest at {self.larger.level}, {abs(self.larger.value):.0f}{unit}"


def headlines(
    table: MeasureTable,
    curves: Sequence[CobbAngle],
    fixed: Mapping[tuple[str, str], str] | None = None,
    states: tuple[str, str] = STATES,
) -> list[Headline]:
    """The numbers before surgery, as patients rank them: waist, hump, shoulders, balance, rotation, curves.

    What the other state does not have is not known.

    Args:
        table: the numbers of the result.
        curves: those of the spine before surgery; the main ones are shown.
        fixed: the words for numbers that the plan fixes, by quantity and level.
        states: that before surgery, and the one that is compared with it.
    """
    was, state = states
    places = {key: [""] for key in _NAMES}
    places["main_hump_mm"] = [table.place("main_hump_mm") or ""]
    places["bsr_deg"] = [table.largest(was, "bsr_deg") or ""]
    places["cobb_deg"] = [curve.ends for curve in main_curves(curves)]
    shown = []
    for key, level in ((key, level) for key, levels in places.items() for level in levels):
        before, after = table.value(was, key, level), table.row(state, key, level)
        if before is None or after is None:
            continue
        of = {"main_hump_mm": "hump_mm", "bsr_deg": "bsr_deg"}.get(key)
        larger = None if of is None else table.larger(state, of, level)
        shown.append(Headline(QUANTITIES[key], before, after, larger, (fixed or {}).get((key, level), "")))
    return shown


def main_curves(curves: Sequence[CobbAngle]) -> list[CobbAngle]:
    """The curves that a spine is named after, top to bottom."""
    largest = max((curve.angle for curve in curves), default=0.0)
    return [curve for curve in curves if curve.angle >= MAIN * largest]


def side_of(value: float) -> str:
    """The patient's side of a number."""
    return "right" if value > 0.0 else "left"


def minus(text: str) -> str:
    """The text with minus signs in place of hyphens."""
    return text.replace("-", "−")
