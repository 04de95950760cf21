"""The measures of a trunk in all its states as one list of rows, for the console, the report and the viewers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from .comparison import DETECTABLE
from .followed_curves import FollowedCurve, followed_curves

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


def measure_rows(states: States) -> dict[str, list[MeasureRow]]:
    """Every measure of the whole trunk, by heading; those that no state has are left out.

    Args:
        states: the measures before surgery and of every state after it; None for a state that is not measured.
    """
    return {"The back": skin_rows(states)} | spine_rows(states)


def skin_rows(states: States) -> list[MeasureRow]:
    """The measures of the skin."""
    rotation = partial(MeasureRow, unit="°", alike=DETECTABLE, sided=True)
    length = partial(MeasureRow, unit="mm", alike=LENGTH)
    rows = [
        rotation(
            name="Rotation of the back (BSR), largest from T1 to T12",
            short="rotation of the upper back",
            values=_of(states, "max_thoracic_bsr"),
        ),
        rotation(
            name="Rotation of the back (BSR), largest from L1 to L5",
            short="rotation of the lower back",
            values=_of(states, "max_lumbar_bsr"),
        ),
        length(name="Hump, largest", short="hump", values=_of(states, "max_hump"), sided=True, key="hump"),
        length(
            name="Higher shoulder, by",
            short="shoulders",
            values=_of(states, "shoulders", "difference"),
            sided=True,
            key="shoulder difference",
        ),
        length(name="Movement of the skin, largest", values=_of(states, "skin_change_max")),
        length(name="Movement of the skin, mean", values=_of(states, "skin_change_mean")),
    ]
    return _known(rows)


def spine_rows(states: States) -> dict[str, list[MeasureRow]]:
    """The measures of the spine, by heading: each curve before surgery, then the spine as a whole."""
    before = states[0]
    if before is None:
        return {}
    groups = {}
    followed = [() if state is None else followed_curves(before, state) for state in states]
    for place, curve in enumerate(followed[0]):
        ends = " and ".join(filter(None, (curve.apex_before.neutral_above, curve.apex_before.neutral_below)))
        heading = f"Curve {curve.ends}, convex to the {curve.before.convex}{', neutral ' * bool(ends)}{ends}"
        groups[heading] = _known(_curve_rows(curve, [curves[place] if curves else None for curves in followed]))
    groups["The spine as a whole"] = _known(_whole_spine_rows(states))
    return {heading: rows for heading, rows in groups.items() if rows}


def level_rows(states: States) -> list[MeasureRow]:
    """The rotation of the back at every vertebra."""
    levels = next((list(state.tangents) for state in states if state is not None), [])
    bsr = [None if state is None else state.bsr for state in states]
    row = partial(MeasureRow, unit="°", alike=DETECTABLE, sided=True)
    return [
        row(name=level, values=tuple(None if a is None else a.get(level) for a in bsr), key=f"bsr {level}")
        for level in levels
    ]


def _curve_rows(curve: FollowedCurve, states: Sequence[FollowedCurve | None]) -> Iterator[MeasureRow]:
    apex, line = curve.before.apex, _LINES.get(curve.apex_before.line, curve.apex_before.line)
    angle = partial(MeasureRow, unit="°", alike=SPINE_ANGLE)
    yield angle(
        name=f"Cobb angle {curve.ends}",
        short=f"Cobb angle {curve.ends}",
        values=tuple(state and state.angle_after for state in states),
        key=f"cobb_deg {curve.before.upper}-{curve.before.lower}",
    )
    yield angle(
        name=f"Rotation of the apical vertebra {apex}",
        short=f"rotation of {apex}",
        values=tuple(state and state.apex_after.rotation for state in states),
        sided=True,
        key=f"apical_rotation_deg {apex}",
    )
    yield MeasureRow(
        name=f"Apical vertebra {apex} beside {line}",
        unit="mm",
        values=tuple(state and state.apex_after.translation for state in states),
        sided=True,
        alike=LENGTH,
    )


def _whole_spine_rows(states: States) -> Iterator[MeasureRow]:
    length = partial(MeasureRow, unit="mm", alike=LENGTH)
    yield length(
        name="Top of the spine beside the sacrum",
        short="balance to the side",
        values=_of(states, "trunk_shift", "lateral"),
        sided=True,
        key="trunk_shift_mm",
    )
    yield length(
        name="Top of the spine in front of the sacrum",
        values=_of(states, "trunk_shift", "forward"),
        key="trunk_shift_forward_mm",
    )
    for measure, ends, short in (
        ("kyphosis", "T5-T12", "kyphosis"),
        ("kyphosis", "T1-T12", ""),
        ("lordosis", "L1-L5", "lordosis"),
        ("lordosis", "L1-S1", ""),
    ):
        yield MeasureRow(
            name=f"{measure.capitalize()} {ends.replace('-', ' to ')}",
            unit="°",
            values=_of(states, measure, ends),
            alike=SPINE_ANGLE,
            short=short,
            key=f"{measure}_deg {ends}",
        )
    yield length(
        name="Height of the spine",
        short="height of the spine",
        values=_of(states, "spine_height", "height"),
        key="spine_height_mm",
    )


def _of(states: States, measure: str, part: str = "") -> tuple[float | None, ...]:
    """A measure, or a part of it, in every state."""
    found = [None if state is None else getattr(state, measure) for state in states]
    if not part:
        return tuple(found)
    return tuple(
        None if one is None else one[part] if isinstance(one, Mapping) else getattr(one, part) for one in found
    )


def _known(rows: Iterator[MeasureRow] | list[MeasureRow]) -> list[MeasureRow]:
    return [row for row in rows if any(value is not None for value in row.values)]


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
