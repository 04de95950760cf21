"""The measures of a trunk in all its states as one list of rows, for the console, the report and the viewers."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from .comparison import DETECTABLE
from .followed_curves import followed_curves

if TYPE_CHECKING:
    from .measures import TrunkMeasures

    States = Sequence[TrunkMeasures | None]

MISSING = "–"
SPINE_ANGLE = 5.0
"""Angles of the spine that differ by less are alike [degrees]: two readers of a film differ by so much."""
LENGTH = 5.0
"""Lengths that differ by less are alike [mm]."""
_LINES = {"L5": "the lower endplate of L5", "pelvis": "the middle of the pelvis"}


@dataclass(frozen=True, kw_only=True)
class MeasureRow:
    """One measure in every state of a trunk."""

    name: str
    """The measured quantity."""
    unit: str
    """° or mm."""
    values: tuple[float | None, ...]
    """Its value in each state, before surgery first; None where it is missing."""
    sided: bool = False
    """Whether it is positive to the patient's right, or where the right side stands further back."""
    alike: float
    """States that differ by less cannot be distinguished by it."""
    short: str = ""
    """Its name within a sentence; empty for a measure by which no plan is chosen."""
    key: str = ""
    """The name of its band in a result with bands."""

    @property
    def title(self) -> str:
        """Its name with its unit."""
        return f"{self.name} [{self.unit}]"

    @property
    def differs(self) -> bool | None:
        """Whether the states after the first can be distinguished by it; None where one value is missing."""
        known = [value for value in self.values[1:] if value is not None]
        return None if len(known) < len(self.values) - 1 else max(known) - min(known) >= self.alike

    def text(self, value: float | None) -> str:
        """A value of this measure as text."""
        return sided(value) if self.sided else number(value)

    def cells(self) -> list[str]:
        """Its title and the value in each state."""
        return [self.title, *map(self.text, self.values)]

    def compared_cells(self) -> list[str]:
        """Its title, the values before and predicted, the change, and for an actual state its value and the error.

        The change is that of the size, whatever its side, between the numbers as they are shown.
        """
        before, predicted, *actual = self.values
        change = None
        if before is not None and predicted is not None:
            change = rounded(predicted) - rounded(before)
            if self.sided:
                change = abs(rounded(predicted)) - abs(rounded(before))
        cells = [self.title, self.text(before), self.text(predicted), number(change, sign=True)]
        for value in actual:
            error = None if value is None or predicted is None else abs(predicted - value)
            cells += [self.text(value), number(error)]
        return cells


_BSR = "Rotation of the back (BSR), largest from"
_BACK = (
    (f"{_BSR} T1 to T12", "°", "max_thoracic_bsr", "rotation of the upper back", ""),
    (f"{_BSR} L1 to L5", "°", "max_lumbar_bsr", "rotation of the lower back", ""),
    ("Hump, largest", "mm", "max_hump", "hump", "hump"),
    ("Higher shoulder, by", "mm", "shoulders.difference", "shoulders", "shoulder difference"),
    ("Movement of the skin, largest", "mm", "skin_change_max", "", ""),
    ("Movement of the skin, mean", "mm", "skin_change_mean", "", ""),
)
"""Name, unit, where `value_at` finds it, name within a sentence, and name of the band."""
_CURVE = (
    ("Cobb angle {ends}", "°", "angle_after", "Cobb angle {ends}", "cobb_deg {upper}-{lower}"),
    ("Rotation of the apical vertebra {apex}", "°", "apex_after.rotation", "rotation of {apex}",
     "apical_rotation_deg {apex}"),
    ("Apical vertebra {apex} beside {line}", "mm", "apex_after.translation", "", ""),
)  # fmt: skip
_SPINE = (
    ("Top of the spine beside the sacrum", "mm", "trunk_shift.lateral", "balance to the side", "trunk_shift_mm"),
    ("Top of the spine in front of the sacrum", "mm", "trunk_shift.forward", "", "trunk_shift_forward_mm"),
    ("Kyphosis T5 to T12", "°", "kyphosis.T5-T12", "kyphosis", "kyphosis_deg T5-T12"),
    ("Kyphosis T1 to T12", "°", "kyphosis.T1-T12", "", "kyphosis_deg T1-T12"),
    ("Lordosis L1 to L5", "°", "lordosis.L1-L5", "lordosis", "lordosis_deg L1-L5"),
    ("Lordosis L1 to S1", "°", "lordosis.L1-S1", "", "lordosis_deg L1-S1"),
    ("Height of the spine", "mm", "spine_height.height", "height of the spine", "spine_height_mm"),
)
_SIDED = re.compile(r"bsr|max_|shoulders|apex|trunk_shift\.lateral")
"""Where measures stand that have a side."""


def measure_rows(states: States) -> dict[str, list[MeasureRow]]:
    """Every measure of the whole trunk, by heading; those that no state has are left out.

    Args:
        states: the measures before surgery and of every state after it; None for a state that is not measured.
    """
    return {"The back": skin_rows(states)} | spine_rows(states)


def skin_rows(states: States) -> list[MeasureRow]:
    """The measures of the skin."""
    return _rows(_BACK, states, DETECTABLE)


def spine_rows(states: States) -> dict[str, list[MeasureRow]]:
    """The measures of the spine, by heading: each curve before surgery, then the spine as a whole."""
    before = states[0]
    if before is None:
        return {}
    groups = {}
    followed = [() if state is None else followed_curves(before, state) for state in states]
    for place, first in enumerate(followed[0]):
        curve, apex = first.before, first.apex_before
        neutral = " and ".join(filter(None, (apex.neutral_above, apex.neutral_below)))
        heading = f"Curve {first.ends}, convex to the {curve.convex}{', neutral ' * bool(neutral)}{neutral}"
        words = {**vars(curve), "ends": first.ends, "line": _LINES.get(apex.line, apex.line)}
        groups[heading] = _rows(_CURVE, [each[place] if each else None for each in followed], SPINE_ANGLE, words)
    groups["The spine as a whole"] = _rows(_SPINE, states, SPINE_ANGLE)
    return {heading: rows for heading, rows in groups.items() if rows}


def level_rows(states: States) -> list[MeasureRow]:
    """The rotation of the back at every vertebra."""
    levels = next((list(state.tangents) for state in states if state is not None), [])
    table = [(level, "°", f"bsr.{level}", "", f"bsr {level}") for level in levels]
    return _rows(table, states, DETECTABLE, known=False)


def _rows(
    table: Sequence[tuple[str, str, str, str, str]],
    states: Sequence[Any],
    angle: float,
    words: Mapping[str, Any] | None = None,
    *,
    known: bool = True,
) -> list[MeasureRow]:
    """The rows of a table, those that no state has left out where only what is known is asked for."""
    found = []
    for name, unit, path, short, key in table:
        values = tuple(value_at(state, path) for state in states)
        if not known or any(value is not None for value in values):
            name, short, key = (text.format_map(words or {}) for text in (name, short, key))
            named: dict[str, str] = {"name": name, "unit": unit, "short": short, "key": key}
            alike = LENGTH if unit == "mm" else angle
            found.append(MeasureRow(**named, values=values, sided=_SIDED.match(path) is not None, alike=alike))
    return found


def value_at(found: Any, path: str) -> Any:
    """The value at a path such as `kyphosis.T5-T12` of fields and names; None where a part is missing."""
    for part in path.split("."):
        if found is None:
            return None
        found = found.get(part) if isinstance(found, Mapping) else getattr(found, part)
    return found


def rounded(value: float) -> float:
    """A value with the digits that are shown: two, or all before the point."""
    return round(value, 0 if abs(value) >= 9.95 else 1)


def number(value: float | None, *, sign: bool = False) -> str:
    """A number with two digits, or all before the point, never -0; a dash where it is missing."""
    if value is None:
        return MISSING
    text = f"{value:{'+' if sign else ''}z.{0 if abs(value) >= 9.95 else 1}f}".replace("-", "−")
    return "0.0" if text == "+0.0" else text


def sided(value: float | None) -> str:
    """A number that is positive to the right, with its side in words; a dash where it is missing."""
    if value is None:
        return MISSING
    size = number(abs(value))
    return size if size == "0.0" else f"{size} {'right' if value > 0.0 else 'left'}"
