"""Every measured quantity, defined once, and the table of measured numbers that all who show or keep them read."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from warp_trunk.case.anatomy import LUMBAR, THORACIC
from warp_trunk.spine.apical import apical_vertebrae
from warp_trunk.spine.cobb import angles_between

from .levels import JUDGED, Values, largest_at
from .measures import TrunkMeasures
from .scoliometer import forward_bend

DETECTABLE = 2.5
"""Smallest detectable difference of the maximum back surface rotation [degrees] (section 4.5 of [2])."""
SPINE_ANGLE = 5.0
"""Angles of the spine that differ by less are alike [degrees]: two readers of a film differ by so much."""
LENGTH = 5.0
"""Lengths that differ by less are alike [mm]."""
WIDTH = 1.959964
"""Standard deviations to either side that hold 95 % of a normal distribution."""
LIKELY = 1.281552
"""The same of 80 %."""
BEFORE, PREDICTED, ACTUAL, EXACT = "before", "predicted", "actual", "exact"
"""States of a result: before surgery, predicted (of the spine: as planned), as scanned after surgery, and as
predicted with the intervals of a plan that is carried out exactly."""
BETTER, WORSE = "likely better", "likely worse"
"""The predicted skin with its main hump at either end of the 80 % interval."""


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A measured quantity."""

    key: str
    """Its name in tables and files; a unit ends it."""
    label: str
    """Its name for a reader; {level} and {ends} stand for where it is measured."""
    unit: str
    """°, mm or %."""
    group: Literal["level", "back", "curve", "spine"]
    """Whether it is known at each vertebra, of the back, of each curve of the spine, or of the spine as a
    whole."""
    function: Callable[[TrunkMeasures, TrunkMeasures], Values]
    """Its values by level, from the measures of a trunk and those of the reference, the trunk before surgery as a
    rule: curves, apices and the place of a maximum are those of the reference, so that states are compared at
    the same place."""
    side: bool = False
    """Whether it is positive to the patient's right, or where the right side stands further back."""
    smaller_is_better: bool = False
    """Whether a smaller one is better though it has no side."""
    detectable: float = LENGTH
    """States that differ by less cannot be distinguished by it [unit]."""
    short: str = ""
    """Its name within a sentence; empty for a quantity by which no plan is chosen."""
    short_at: str = ""
    """The only level at which a plan is chosen by it; empty for every level."""
    of_skin: bool = False
    """Whether it is measured on the skin."""
    largest_of: str = ""
    """The quantity by level whose value it is where the reference has its largest; empty for any other."""
    levels: tuple[str, ...] = JUDGED
    """Among which levels that is."""

    @property
    def should_be_small(self) -> bool:
        """Whether 0 is best, as of any difference of the two sides."""
        return self.side or self.smaller_is_better

    def label_at(self, level: str) -> str:
        """Its name for a reader at a level."""
        return self.label.format(level=level, ends=level.replace("-", " to "))

    def short_name(self, level: str) -> str:
        """Its name within a sentence at a level; empty where no plan is chosen by it."""
        chosen = not self.short_at or level == self.short_at
        return self.short.format(level=level, ends=level.replace("-", " to ")) if chosen else ""


def _apical(measures: TrunkMeasures, reference: TrunkMeasures, what: str) -> Values:
    """A field of the apical vertebra that each curve has in the reference."""
    if measures.sacral_line is None:
        return {}
    apices = apical_vertebrae(measures.spine, reference.cobb, measures.axial_rotation, measures.sacral_line)
    return {apex.level: getattr(apex, what) for apex in apices}


def _cobb(measures: TrunkMeasures, reference: TrunkMeasures) -> Values:
    angles = angles_between(reference.cobb, measures.spine)
    return {curve.ends: angle for curve, angle in zip(reference.cobb, angles, strict=True)}


def _largest(key: str, levels: tuple[str, ...] = JUDGED) -> dict[str, Any]:
    """A quantity by level at the place where the reference has its largest size among some levels. Where a state
    has more at another level, `MeasureTable.elsewhere` finds it."""

    def values(measures: TrunkMeasures, reference: TrunkMeasures) -> Values:
        function = QUANTITIES[key].function
        place = largest_at(function(reference, reference), levels)
        return {} if place is None else {place: function(measures, reference).get(place)}

    return {"largest_of": key, "levels": levels, "function": values}


def _flank(what: str) -> Callable[[TrunkMeasures, TrunkMeasures], Values]:
    def values(measures: TrunkMeasures, _: TrunkMeasures) -> Values:
        return {level: flank and getattr(flank, what) for level, flank in measures.flanks.items()}

    return values


_LEVEL: dict[str, Any] = {"group": "level"}
_BACK: dict[str, Any] = {"group": "back", "of_skin": True}
_CURVE: dict[str, Any] = {"group": "curve"}
_SPINE: dict[str, Any] = {"group": "spine"}
_BSR = "Rotation of the back (BSR)"
_DEFINED = (
    Quantity(key="bsr_deg", label=f"{_BSR} at {{level}}", unit="°", side=True, detectable=DETECTABLE, **_LEVEL,
             of_skin=True, function=lambda m, _: m.bsr),
    Quantity(key="atr_deg", label="Scoliometer on the standing back at {level}", unit="°", side=True,
             detectable=SPINE_ANGLE, **_LEVEL, of_skin=True, function=lambda m, _: m.slopes),
    Quantity(key="forward_bend_deg", label="Scoliometer in the forward bend at {level}, in the mean", unit="°",
             side=True, detectable=SPINE_ANGLE, **_LEVEL, of_skin=True,
             function=lambda m, _: forward_bend(m.slopes)),
    Quantity(key="axial_rotation_deg", label="Rotation of the vertebra {level}", unit="°", side=True,
             detectable=SPINE_ANGLE, **_LEVEL, function=lambda m, _: m.axial_rotation),
    Quantity(key="tilt_deg", label="Tilt of {level} from the front", unit="°", side=True,
             detectable=SPINE_ANGLE, **_LEVEL, function=lambda m, _: m.tilts),
    Quantity(key="disc_angle_deg", label="Tilt of {level} against the next vertebra", unit="°", side=True,
             detectable=SPINE_ANGLE, **_LEVEL, function=lambda m, _: m.disc_angles),
    Quantity(key="hump_mm", label="Hump at {level}", unit="mm", side=True, **_LEVEL, of_skin=True,
             function=lambda m, _: m.hump_height),
    Quantity(key="left_flank_mm", label="Width to the left at {level}", unit="mm", **_LEVEL, of_skin=True,
             function=_flank("left")),
    Quantity(key="right_flank_mm", label="Width to the right at {level}", unit="mm", **_LEVEL, of_skin=True,
             function=_flank("right")),
    Quantity(key="flank_asymmetry_percent", label="Asymmetry of the flanks at {level}", unit="%", side=True,
             **_LEVEL, of_skin=True, function=_flank("index")),
    Quantity(key="waist_height_mm", label="Higher waist, by", unit="mm", side=True, short="height of the waist",
             **_BACK, function=lambda m, _: {"": m.waist and m.waist.height_difference}),
    Quantity(key="waist_depth_mm", label="Deeper waist, by", unit="mm", side=True, **_BACK,
             short="depth of the waist", function=lambda m, _: {"": m.waist and m.waist.depth_difference}),
    Quantity(key="waist_depth_left_mm", label="Depth of the left waist", unit="mm", **_BACK,
             function=lambda m, _: {"": m.waist and m.waist.left_depth}),
    Quantity(key="waist_depth_right_mm", label="Depth of the right waist", unit="mm", **_BACK,
             function=lambda m, _: {"": m.waist and m.waist.right_depth}),
    Quantity(key="main_hump_mm", label="Main hump, at {level}", unit="mm", side=True,
             short="hump at {level}", **_BACK, **_largest("hump_mm")),
    Quantity(key="shoulder_difference_mm", label="Higher shoulder, by", unit="mm", side=True, short="shoulders",
             **_BACK, function=lambda m, _: {"": m.shoulders and m.shoulders.difference}),
    Quantity(key="thoracic_bsr_deg", label="Rotation of the upper back (BSR) at {level}", unit="°",
             side=True, detectable=DETECTABLE, short="rotation of the upper back at {level}", **_BACK,
             **_largest("bsr_deg", THORACIC[2:])),
    Quantity(key="lumbar_bsr_deg", label="Rotation of the lower back (BSR) at {level}", unit="°",
             side=True, detectable=DETECTABLE, short="rotation of the lower back at {level}", **_BACK,
             **_largest("bsr_deg", LUMBAR)),
    Quantity(key="main_atr_deg", label="Scoliometer on the standing back at {level}", unit="°", side=True,
             detectable=SPINE_ANGLE, short="scoliometer at {level}", **_BACK, **_largest("atr_deg")),
    Quantity(key="clavicle_angle_deg", label="Angle of the shoulders", unit="°", side=True,
             detectable=DETECTABLE, **_BACK, function=lambda m, _: {"": m.shoulders and m.shoulders.angle}),
    Quantity(key="waist_height_angle_deg", label="Waist height angle", unit="°", side=True,
             detectable=DETECTABLE, **_BACK, function=lambda m, _: {"": m.waist and m.waist.height_angle}),
    Quantity(key="waist_angle_ratio_percent", label="Waist angle ratio, right over left", unit="%", **_BACK,
             function=lambda m, _: {"": m.waist and m.waist.angle_ratio}),
    Quantity(key="waistline_depth_ratio_percent", label="Waistline depth ratio, left over right", unit="%",
             detectable=20.0, **_BACK, function=lambda m, _: {"": m.waist and m.waist.depth_ratio}),
    Quantity(key="skin_change_max_mm", label="Movement of the skin, largest", unit="mm", **_BACK,
             function=lambda m, _: {"": m.skin_change_max}),
    Quantity(key="skin_change_mean_mm", label="Movement of the skin, mean", unit="mm", **_BACK,
             function=lambda m, _: {"": m.skin_change_mean}),
    Quantity(key="cobb_deg", label="Cobb angle {ends}", unit="°", smaller_is_better=True, detectable=SPINE_ANGLE,
             **_CURVE, short="Cobb angle {ends}", function=_cobb),
    Quantity(key="apical_rotation_deg", label="Rotation of the apical vertebra {level}", unit="°", side=True,
             detectable=SPINE_ANGLE, short="rotation of {level}", **_CURVE,
             function=lambda m, reference: _apical(m, reference, "rotation")),
    Quantity(key="apical_translation_mm", label="Apical vertebra {level} beside the vertical through the sacrum",
             unit="mm", side=True, **_CURVE, function=lambda m, reference: _apical(m, reference, "translation")),
    Quantity(key="trunk_shift_mm", label="Top of the spine beside the sacrum", unit="mm", side=True, **_SPINE,
             short="balance to the side", function=lambda m, _: {"": m.trunk_shift and m.trunk_shift.lateral}),
    Quantity(key="trunk_shift_forward_mm", label="Top of the spine in front of the sacrum", unit="mm", **_SPINE,
             function=lambda m, _: {"": m.trunk_shift and m.trunk_shift.forward}),
    Quantity(key="t1_tilt_deg", label="Tilt of T1", unit="°", side=True, detectable=SPINE_ANGLE, **_SPINE,
             function=lambda m, _: {"": m.tilts.get("T1")}),
    Quantity(key="trunk_length_mm", label="Length of the trunk, C7 to the iliac spines", unit="mm", **_SPINE,
             function=lambda m, _: {"": m.trunk_length}),
    Quantity(key="kyphosis_deg", label="Kyphosis {ends}", unit="°", detectable=SPINE_ANGLE, short="kyphosis",
             short_at="T5-T12", **_SPINE, function=lambda m, _: m.kyphosis),
    Quantity(key="lordosis_deg", label="Lordosis {ends}", unit="°", detectable=SPINE_ANGLE, short="lordosis",
             short_at="L1-L5", **_SPINE, function=lambda m, _: m.lordosis),
    Quantity(key="spine_height_mm", label="Height of the spine", unit="mm", short="height of the spine", **_SPINE,
             function=lambda m, _: {"": m.spine_height and m.spine_height.height}),
)  # fmt: skip
QUANTITIES = {quantity.key: quantity for quantity in _DEFINED}
"""The registry: every quantity by its key, in the order in which tables show them: as patients rank them, the
waist first."""


def quantities_of(*groups: str) -> list[Quantity]:
    """The quantities of some groups."""
    return [quantity for quantity in _DEFINED if quantity.group in groups]


@dataclass(frozen=True)
class Measured:
    """One measured number: a row of the table of a result."""

    state: str
    """Of which state of the trunk: before, predicted, actual, or another that the table defines."""
    level: str
    """Where: a vertebra, the ends of a curve such as T5-T12, a region of the skin; empty for the whole trunk."""
    quantity: str
    """What: a key of `QUANTITIES`, which a unit ends."""
    value: float | None
    """The number, positive to the patient's right where it has a side; None where it cannot be measured."""
    low: float | None = None
    """Where the interval begins that holds it in 19 of 20 cases; None without `--bands` ..."""
    high: float | None = None
    """... and where it ends."""

    @classmethod
    def with_sd(cls, state: str, level: str, quantity: str, value: float, sd: float) -> Measured:
        """A number that is normally distributed with a standard deviation."""
        return cls(state, level, quantity, value, value - WIDTH * sd, value + WIDTH * sd)

    @property
    def sd(self) -> float:
        """Its standard deviation; NaN where it has no interval."""
        return math.nan if self.low is None or self.high is None else (self.high - self.low) / (2.0 * WIDTH)

    def holds(self, value: float | None) -> bool | None:
        """Whether a value lies in its interval; None where one of them is not known."""
        if value is None or self.low is None or self.high is None:
            return None
        return self.low <= value <= self.high


COLUMNS = ("state", "level", "quantity", "value", "low", "high")
"""The fields of `Measured`: the columns of the table."""


def measured(
    state: str,
    measures: TrunkMeasures,
    reference: TrunkMeasures | None = None,
    *,
    of: Literal["skin", "spine"] | None = None,
) -> list[Measured]:
    """The rows of one state of a trunk, for every quantity.

    Args:
        state: its name.
        measures: what `measure` found.
        reference: the trunk whose curves and places it is compared at, as a rule before surgery; itself when left
            out.
        of: what is known of this state; both when left out.
    """
    reference = measures if reference is None else reference
    return [
        Measured(state, level, quantity.key, value)
        for quantity in _DEFINED
        if of is None or quantity.of_skin == (of == "skin")
        for level, value in quantity.function(measures, reference).items()
    ]


class MeasureTable:
    """The rows of a result, found by state, quantity and level."""

    def __init__(self, rows: Iterable[Measured]) -> None:
        self.rows = tuple(rows)
        """Every row, in order."""

    @classmethod
    def of(cls, states: Mapping[str, TrunkMeasures]) -> MeasureTable:
        """Every quantity of some states of a trunk, by name, at the places of the first."""
        reference = next(iter(states.values()))
        return cls(row for name, measures in states.items() for row in measured(name, measures, reference))

    @cached_property
    def _columns(self) -> dict[tuple[str, str], dict[str, Measured]]:
        columns: dict[tuple[str, str], dict[str, Measured]] = {}
        for row in self.rows:
            columns.setdefault((row.state, row.quantity), {})[row.level] = row
        return columns

    def column(self, state: str, quantity: str) -> dict[str, Measured]:
        """The rows of a quantity in a state, by level, top to bottom."""
        return self._columns.get((state, quantity), {})

    def values(self, state: str, quantity: str) -> dict[str, float | None]:
        """The values of a quantity in a state, by level."""
        return {level: row.value for level, row in self.column(state, quantity).items()}

    def value(self, state: str, quantity: str, level: str = "") -> float | None:
        """A single value; None where it is missing or not in the table."""
        row = self.row(state, quantity, level)
        return None if row is None else row.value

    def row(self, state: str, quantity: str, level: str = "") -> Measured | None:
        """A single row; None where it is not in the table."""
        return self.column(state, quantity).get(level)

    def largest(self, state: str, quantity: str) -> str | None:
        """The level of `JUDGED` at which a quantity has its largest size; None where it is known at none."""
        return largest_at(self.values(state, quantity))

    def place(self, quantity: str) -> str | None:
        """Where a quantity is measured that all states have at one place; None where no state has it."""
        return next((row.level for row in self.rows if row.quantity == quantity), None)

    def elsewhere(self, state: str, quantity: str) -> Measured | None:
        """Where a state has more than at the place of a maximum (`Quantity.largest_of`), its row there; None where
        that place has as much, as it is shown."""
        maximum = QUANTITIES[quantity]
        return self.larger(state, maximum.largest_of, self.place(quantity) or "", maximum.levels)

    def larger(self, state: str, quantity: str, level: str, levels: Sequence[str] = JUDGED) -> Measured | None:
        """The row of the largest of some levels where that is more than at a level, as it is shown; else None."""
        value, largest = self.value(state, quantity, level), largest_at(self.values(state, quantity), levels)
        row = None if largest is None else self.row(state, quantity, largest)
        if row is None or row.value is None or value is None or round(abs(row.value)) <= round(abs(value)):
            return None
        return row

    def with_rows(self, replacements: Iterable[Measured]) -> MeasureTable:
        """The table with other rows in place of those of the same state, level and quantity, or after all."""
        new = {(row.state, row.level, row.quantity): row for row in replacements}
        rows = [new.pop((row.state, row.level, row.quantity), row) for row in self.rows]
        return MeasureTable([*rows, *new.values()])

    def with_intervals(self, rows: Iterable[Measured]) -> MeasureTable:
        """The table with the intervals of rows of the same state, level and quantity, whose values stay its own;
        rows of other states come after all."""
        new = {(row.state, row.level, row.quantity): row for row in rows}
        own_keys = {(row.state, row.level, row.quantity): row for row in self.rows}
        rows_with_intervals = [
            row if (by := new.get(key)) is None else replace(row, low=by.low, high=by.high)
            for key, row in own_keys.items()
        ]
        return MeasureTable([*rows_with_intervals, *(row for key, row in new.items() if key not in own_keys)])

    def to_rows(self) -> list[dict[str, Any]]:
        """The rows as dictionaries of `COLUMNS`; a number that is not known is None."""
        return [asdict(row) for row in self.rows]

    def to_columns(self) -> dict[str, np.ndarray]:
        """The rows as arrays by `COLUMNS`, for pandas or polars as they are: texts, and float64 with NaN where a
        number is not known, also where all of a column are."""
        kinds = dict.fromkeys(COLUMNS[:3], np.str_) | dict.fromkeys(COLUMNS[3:], np.float64)
        return {name: np.array([getattr(row, name) for row in self.rows], dtype=kinds[name]) for name in COLUMNS}
