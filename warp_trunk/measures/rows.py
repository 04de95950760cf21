"""Quantities side by side in several states of a trunk, as lines of a table for a reader."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .quantities import BEFORE, PREDICTED, MeasureTable, Quantity, quantities_of

if TYPE_CHECKING:
    from .apical import ApicalVertebra
    from .cobb import CobbAngle
    from .measures import TrunkMeasures

STATES = BEFORE, PREDICTED
"""The states that are shown side by side where nothing else is asked for."""

MISSING = "–"
WORSE = "▲"
"""Marks what should be small and grows."""


@dataclass(frozen=True, kw_only=True)
class MeasureRow:
    """One quantity at one level in every state of a trunk."""

    quantity: Quantity
    """The quantity."""
    level: str
    """Where it is measured; empty for the whole trunk."""
    values: tuple[float | None, ...]
    """Its value in each state, before surgery first; None where it is missing."""

    @property
    def name(self) -> str:
        """Its name for a reader."""
        return self.quantity.label_at(self.level)

    @property
    def short(self) -> str:
        """Its name within a sentence; empty for a measure by which no plan is chosen."""
        return self.quantity.short_name(self.level)

    @property
    def title(self) -> str:
        """Its name with its unit."""
        return f"{self.name} [{self.quantity.unit}]"

    @property
    def differs(self) -> bool | None:
        """Whether the states after the first can be distinguished by it; None where one value is missing."""
        known = [value for value in self.values[1:] if value is not None]
        if len(known) < len(self.values) - 1:
            return None
        return max(known) - min(known) >= self.quantity.detectable

    def text(self, value: float | None) -> str:
        """A value of this measure as text."""
        return sided(value) if self.quantity.side else number(value)

    def cells(self) -> list[str]:
        """Its title and the value in each state."""
        return [self.title, *map(self.text, self.values)]

    def compared_cells(self) -> list[str]:
        """Its title, the values before and predicted, the change, and for an actual state its value and the error.

        The change is that of the size, whatever its side, between the numbers as they are shown. `WORSE` marks a
        difference of sides or a curve that grows; a change of side stands in words.
        """
        before, predicted, *actual = self.values
        change = MISSING
        if before is not None and predicted is not None:
            was, will = rounded(before), rounded(predicted)
            uneven = self.quantity.side or self.quantity.key == "cobb_deg"
            more = abs(will) - abs(was) if uneven else will - was
            marks = [WORSE] if uneven and more > 0.0 else []
            marks += ["other side"] if uneven and was * will < 0.0 else []
            change = " ".join([number(more, sign=True), *marks])
        cells = [self.title, self.text(before), self.text(predicted), change]
        for value in actual:
            error = None if value is None or predicted is None else abs(predicted - value)
            cells += [self.text(value), number(error)]
        return cells


def measure_rows(
    table: MeasureTable, before: TrunkMeasures, states: Sequence[str] = STATES
) -> dict[str, list[MeasureRow]]:
    """Every measure of the whole trunk, by heading; those that no state has are left out.

    Args:
        table: the numbers.
        before: the trunk before surgery, whose curves the headings name.
        states: the states to show, before surgery first.
    """
    return {"The back": skin_rows(table, states)} | spine_rows(table, before, states)


def skin_rows(table: MeasureTable, states: Sequence[str] = STATES) -> list[MeasureRow]:
    """The measures of the skin."""
    return _rows("back", table, states)


def spine_rows(
    table: MeasureTable, before: TrunkMeasures, states: Sequence[str] = STATES
) -> dict[str, list[MeasureRow]]:
    """The measures of the spine, by heading: each curve before surgery, then the spine as a whole."""
    of_curves = _rows("curve", table, states)
    groups = {
        curve_heading(curve, apex): [row for row in of_curves if row.level in (curve.ends, curve.apex)]
        for curve, apex in zip(before.cobb, before.apices, strict=True)
    }
    groups["The spine as a whole"] = _rows("spine", table, states)
    return {heading: rows for heading, rows in groups.items() if rows}


def curve_heading(curve: CobbAngle, apex: ApicalVertebra) -> str:
    """A curve in words."""
    neutral = " and ".join(filter(None, (apex.neutral_above, apex.neutral_below)))
    words = f"Curve {curve.upper} to {curve.lower}, convex to the {curve.convex}"
    return f"{words}, neutral {neutral}" if neutral else words


def level_rows(table: MeasureTable, states: Sequence[str] = STATES) -> list[MeasureRow]:
    """The rotation of the back at every vertebra, also where no state has it."""
    return [row for row in _rows("level", table, states, known=False) if row.quantity.key == "bsr_deg"]


def _rows(group: str, table: MeasureTable, states: Sequence[str], *, known: bool = True) -> list[MeasureRow]:
    """The rows of a group of quantities; those that no state has are left out where only what is known counts."""
    found = []
    for quantity in quantities_of(group):
        columns = [table.values(state, quantity.key) for state in states]
        for level in dict.fromkeys(level for column in columns for level in column):
            values = tuple(column.get(level) for column in columns)
            if not known or any(value is not None for value in values):
                found.append(MeasureRow(quantity=quantity, level=level, values=values))
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
