"""Quantities side by side in several states of a trunk, and tables of them as text and as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from warp_trunk.spine.apical import ApicalVertebra
from warp_trunk.spine.cobb import CobbAngle

from .comparison import SkinComparison
from .measures import TrunkMeasures
from .number_text import MISSING, interval_text, number, sided, value_text
from .quantities import (
    BEFORE,
    DETECTABLE,
    PREDICTED,
    Measured,
    MeasureTable,
    Quantity,
    measured,
    quantities_of,
)
from .verdicts import NOT_KNOWN, change_text, is_certainly_worse, is_known

WORSE = "▲"
"""Marks what is visibly worse, and certainly so."""
STATES = BEFORE, PREDICTED
"""The states that are shown side by side where nothing else is asked for."""


@dataclass(frozen=True, kw_only=True)
class MeasureRow:
    """One quantity at one level in every state of a trunk."""

    quantity: Quantity
    """The quantity."""
    level: str
    """Where it is measured; empty for the whole trunk."""
    numbers: tuple[Measured | None, ...]
    """Its row of the table in each state, before surgery first; None where it is missing."""

    fixed: str = ""
    """Words in place of an interval, where a plan fixes it."""

    @property
    def values(self) -> tuple[float | None, ...]:
        """Its value in each state; None where it is missing."""
        return tuple(None if row is None else row.value for row in self.numbers)

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
        values = [value for value in self.values[1:] if value is not None]
        if len(values) < len(self.values) - 1:
            return None
        return max(values) - min(values) >= self.quantity.detectable

    def is_known(self, state: int) -> bool:
        """Whether its value in a state, by number, is there and says more than its interval is wide."""
        return bool(self.fixed) or is_known(self.quantity, self.numbers[state], self.values[0] if state else None)

    def text(self, value: float | None, unit: str = "") -> str:
        """A value of this measure as text, with a unit after the number."""
        return value_text(self.quantity, value, unit)

    def cells(self) -> list[str]:
        """Its title and the value in each state, in words where that is not known."""
        return [self.title, *map(self._cell, range(len(self.numbers)))]

    def _cell(self, state: int) -> str:
        value = self.values[state]
        return self.text(value) if value is None or self.is_known(state) else NOT_KNOWN

    def compared_cells(self) -> list[str]:
        """Its cells with the change from the first to the second state (`change_text`) after both, and after each
        further state, an actual one, how far the prediction is from it. `WORSE` marks what is visibly worse for
        certain."""
        title, before, predicted, *actual = self.cells()
        change = change_text(self.quantity, *self.values[:2]) if self.is_known(1) else MISSING
        cells = [title, before, predicted, f"{change} {WORSE}" if self.is_worse else change]
        for text, value in zip(actual, self.values[2:], strict=True):
            error = None if value is None or self.values[1] is None else abs(self.values[1] - value)
            cells += [text, number(error) if self.is_known(1) else MISSING]
        return cells

    @property
    def interval(self) -> str:
        """Where its second state lies in 19 of 20 cases, or that the plan fixes it; empty for neither."""
        return self.fixed or interval_text(self.numbers[1], sided=self.quantity.side)

    @property
    def is_worse(self) -> bool:
        """Whether its second state is visibly worse than the first, and that is certain."""
        return not self.fixed and is_certainly_worse(self.quantity, self.values[0], self.numbers[1])


def measure_rows(
    table: MeasureTable, before: TrunkMeasures, states: Sequence[str] = STATES
) -> dict[str, list[MeasureRow]]:
    """Every measure of the whole trunk, by heading; those that no state has are left out.

    Args:
        table: the numbers.
        before: the trunk before surgery, whose curves the headings name.
        states: the states to show, before surgery first.
    """
    return {skin_heading(before): skin_rows(table, states)} | spine_rows(table, before, states)


def skin_heading(before: TrunkMeasures) -> str:
    """The heading of the measures of the skin: a part of the body without a spine has no back."""
    return "The back" if before.spine.levels else "The skin"


def under_headings(
    groups: Mapping[str, Sequence[MeasureRow]], cells: Callable[[MeasureRow], list[str]] = MeasureRow.cells
) -> list[list[str]]:
    """The cells of all rows, those of each group under its heading, a row of one cell."""
    return [line for heading, rows in groups.items() for line in ([heading], *map(cells, rows))]


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
    return [row for row in _rows("level", table, states, only_known=False) if row.quantity.key == "bsr_deg"]


def rotation_table(
    table: MeasureTable,
    states: Sequence[str] = STATES,
    cells: Callable[[MeasureRow], list[str]] = MeasureRow.cells,
    *,
    bands: bool = False,
) -> list[list[str]]:
    """The rotation of the back [degrees], a row for each level, with its interval where that is asked for."""
    return [[row.level, *cells(row)[1:], *([row.interval] if bands else [])] for row in level_rows(table, states)]


def _rows(group: str, table: MeasureTable, states: Sequence[str], *, only_known: bool = True) -> list[MeasureRow]:
    """The rows of a group of quantities; those that no state has are left out where only what is known counts."""
    rows = []
    for quantity in quantities_of(group):
        columns = [table.column(state, quantity.key) for state in states]
        for level in dict.fromkeys(level for column in columns for level in column):
            row = MeasureRow(quantity=quantity, level=level, numbers=tuple(c.get(level) for c in columns))
            if not only_known or any(value is not None for value in row.values):
                rows.append(row)
    return rows


RESEARCH = "A research simulation, not for clinical use."
SIDES = "The side is that which stands further back, higher or wider, or to which the spine is shifted."
Row = Sequence[str]
"""The cells of a row; a row of one cell is a heading."""


def as_text(head: Row, rows: Sequence[Row]) -> str:
    """The table in columns of one width each: the first on the left, all others on the right."""
    table = [head, *rows]
    widths = [max(len(row[column]) for row in table if len(row) > max(column, 1)) for column in range(len(head))]
    return "\n".join(
        row[0] if len(row) == 1
        else "  ".join([row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))])
        for row in table
    )  # fmt: skip


def as_markdown(head: Row, rows: Sequence[Row]) -> str:
    """The table in Markdown; a heading is a bold row."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)]]
    lines += [[f"**{row[0]}**", *[""] * (len(head) - 1)] if len(row) == 1 else row for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def measures_text(measures: TrunkMeasures, reference: TrunkMeasures) -> str:
    """Every measure of one skin, a maximum at the place that it has in the reference: the whole trunk, then by
    level, then what is missing and why."""
    table = MeasureTable(measured(BEFORE, measures, reference))
    whole = under_headings(measure_rows(table, reference, (BEFORE,)))
    by_level = (measures.bsr, measures.axial_rotation, measures.hump_height)
    levels = [
        [level, *(sided(each[level]) for each in by_level)]
        + ([number(flanks.left), number(flanks.right), sided(flanks.index)] if flanks else [MISSING] * 3)
        for level, flanks in measures.flanks.items()
    ]
    head = ["level", "back [°]", "vertebra [°]", "hump [mm]"]
    head += ["left flank [mm]", "right flank [mm]", "asymmetry [%]"]
    missing = [f"missing: {what}: {why}" for what, why in measures.missing.items()]
    return "\n".join([as_text(["measure", "value"], whole), "", as_text(head, levels), SIDES, *missing])


def comparison_text(comparison: SkinComparison) -> str:
    """A prediction against the actual skin: rotation as the papers judge it, then distance by region."""
    lines = ["Error of the back surface rotation, predicted against actual"]
    for name, error in comparison.bsr_error.items():
        if error is None:
            lines.append(f"{name:<8} missing: no level has both rotations")
            continue
        spread = "" if error.sd is None else f" ± {error.sd:.2f}"
        verdict = "below" if error.undetectable else "not below"
        lines.append(
            f"{name:<8} {error.mean:.2f}{spread}° on average over {len(error.levels)} levels, {verdict} the "
            f"{DETECTABLE:g}° that can be detected; where the actual is largest {error.of_maximum:+z.2f}°"
        )
    lines += ["", "Back surface rotation, predicted less actual [°]"]
    differences = [
        f"{level} {MISSING if value is None else f'{value:+z.1f}'}"
        for level, value in comparison.bsr_difference.items()
    ]
    lines += [", ".join(differences[first : first + 6]) for first in range(0, len(differences), 6)]
    distances = [
        [region, f"{statistics.area:.0f}", f"{statistics.signed_mean:+z.2f}"]
        + [f"{value:.2f}" for value in (statistics.mean, statistics.rms, statistics.p95, statistics.maximum)]
        + [f"{value:.2f}" for value in (statistics.symmetric_mean, statistics.symmetric_maximum)]
        if statistics
        else [region, *[MISSING] * 8]
        for region, statistics in comparison.distance.items()
    ]
    head = ["region", "area", "signed", "mean", "rms", "95 %", "max", "mean", "max"]
    return "\n".join(
        [
            *lines,
            "",
            "Distance from the prediction to the actual skin [mm], positive outside it; on the right both ways",
            as_text(head, distances),
            "Area in cm2; the flanks may hold the planes where the arms are cut off.",
        ]
    )
