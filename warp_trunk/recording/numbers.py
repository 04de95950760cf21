"""The trunk in numbers: rotations by level as bars, energy and error as plots, a table. Imports Rerun."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import rerun as rr

from warp_trunk.engine.relaxation import Energy
from warp_trunk.measures import TrunkMeasures
from warp_trunk.measures.levels import JUDGED
from warp_trunk.measures.number_text import sided
from warp_trunk.measures.quantities import ACTUAL, BEFORE, Measured, MeasureTable
from warp_trunk.measures.rows import RESEARCH, as_markdown, measure_rows

from .colours import GREY, LABELS, NOW, PLOTTED, TARGET, TEXT, TOTAL

Angles = Mapping[str, float | None]

NAMES_OF_TERMS = {"distance": "edges", "area": "faces"}
"""Names of the terms of an energy in the plot, where they differ."""
MAXIMA = ("thoracic_bsr_deg", "lumbar_bsr_deg")
"""The rotations whose course is plotted: of the upper and the lower back, each where it is largest before."""
BAR = 0.26
"""Height of a bar, where levels are 1 apart and three bars share one."""
NAMES, BETWEEN, ANGLES = 0.05, (0.1, 0.81), 0.91
"""Positions of names, bars with their whiskers, and angles in a plot of bars, as parts of its width."""
SPARE = 5.0
"""Room for the whiskers on either side of the bars [degrees]; a usual rotation is known to 2 degrees."""


class BarPlot:
    """Where bars of angles stand in a picture: a level each row, its name on the left, its angle on the right."""

    def __init__(self, *angles: Angles) -> None:
        """The plot that holds angles by level, those of the first with its levels, and whiskers beside them."""
        self.levels = tuple(angles[0])
        """Names of the rows, the first on top, rows 1 apart."""
        degrees = [angle for each in angles for at, angle in each.items() if angle is not None and at in JUDGED]
        low, high = min([0.0, *degrees]) - SPARE, max([1.0, *degrees]) + SPARE
        self.width = 1.25 * (len(self.levels) + 1)
        """The whole plot is this wide, from 0."""
        self.scale = 0.66 * self.width / (1.1 * (high - low))
        """Length of a bar for each degree."""
        self.zero = 0.12 * self.width - 1.1 * low * self.scale
        """Where bars begin."""

    def bars(self, angles: Angles, place: int) -> list[np.ndarray]:
        """Lines (2, 2) from zero to each known angle [degrees]; `place` is 0 to 2 for the bar of a level."""
        rows = [(row + BAR * (place - 1), angles.get(level)) for row, level in enumerate(self.levels)]
        ends = [(y, self._across(angle)) for y, angle in rows if angle is not None]
        return [np.array([[self.zero, y], [x, y]], np.float32) for y, x in ends]

    def _across(self, angles: float | Sequence[float]) -> np.ndarray:
        """Places of angles [degrees], cut off at names and numbers: those of T1 and T2 set no scale."""
        first, last = (part * self.width for part in BETWEEN)
        return np.clip(self.zero + self.scale * np.asarray(angles), first, last)

    def whiskers(self, ranges: Mapping[str, tuple[float, float]]) -> list[np.ndarray]:
        """Lines (2, 2) over the middle bars from one angle to another [degrees]."""
        ends = [(row, self._across(ranges[level])) for row, level in enumerate(self.levels) if level in ranges]
        return [np.array([[low, row], [high, row]], np.float32) for row, (low, high) in ends]


class Numbers:
    """Logs measures and relaxations; the levels are known by their names."""

    def __init__(
        self, log: Callable[..., None], table: MeasureTable, before: TrunkMeasures, states: Sequence[str]
    ) -> None:
        """Logs what never changes: states of the table, before surgery and the actual one where it is known."""
        self._log, self._before, self._states = log, before, states
        angles = {state: table.values(state, "bsr_deg") for state in states}
        self._plot = plot = BarPlot(*angles.values())
        self._terms: list[str] = []
        log("error", rr.SeriesLines(names="error", colors=PLOTTED[0], widths=2.0), static=True)
        self._places = {key: place for key in MAXIMA if (place := table.place(key))}
        if names := [f"at {place}, to the right above 0" for place in self._places.values()]:
            colours = list(PLOTTED[: len(names)])
            log("bsr", rr.SeriesLines(names=names, colors=colours, widths=[2.0] * len(names)), static=True)
        log("bars/before", self._bars(angles[BEFORE], GREY, 0), static=True)
        if ACTUAL in angles:
            log("bars/target", self._bars(angles[ACTUAL], TARGET, 2), static=True)
        rows, middle = len(plot.levels), 0.5 * plot.width
        zero = [[[plot.zero, -0.7], [plot.zero, rows - 0.3]]]
        log("bars/zero", rr.LineStrips2D(zero, colors=TEXT), static=True)
        worst = [before.worst_level] if before.worst_level else []
        self._named = apart(plot.levels, worst, 2)
        names = self._labels(NAMES, {level: level for level in self._named}, TEXT)
        log("bars/levels", names, static=True)
        states_legend = "grey before, blue now" + (", orange actual" if ACTUAL in angles else "")
        self._legend = f"to the right: the right side stands further back\n{states_legend}"
        self._below = [[middle, rows]]

    def measures(self, table: MeasureTable, load_factor: float) -> None:
        """Logs rotations and the table, whose state now is that at a load factor."""
        angles = table.values("now", "bsr_deg")
        self._log("bars/now", self._bars(angles, NOW, 1))
        self._log("bars/legend", _labels(self._below, [self._legend], TEXT))
        said = {level: sided(angles[level]) for level in self._named if level in angles}
        self._log("bars/angles", self._labels(ANGLES, said, NOW))
        followed = [table.value("now", key, place) for key, place in self._places.items()]
        if followed:
            self._log("bsr", rr.Scalars([math.nan if angle is None else angle for angle in followed]))
        text = side_by_side(table, self._before, self._states, load_factor)
        self._log("table", rr.TextDocument(text, media_type="text/markdown"))
        if angles:
            shown = (BEFORE, "now", *self._states[1:])
            columns = [table.values(state, "bsr_deg") for state in shown]
            rows = [[level, *(sided(column.get(level)) for column in columns)] for level in self._plot.levels]
            text = as_markdown(["[°]", *shown], rows)
            self._log("levels", rr.TextDocument(text, media_type="text/markdown"))

    def bands(self, rotations: Mapping[str, Measured]) -> None:
        """Logs how sure the rotations at the end are, as whiskers over their bars."""
        ends = {level: (row.low, row.high) for level, row in rotations.items()}
        ends = {level: (low, high) for level, (low, high) in ends.items() if low is not None and high is not None}
        lines = self._plot.whiskers(ends)
        radii = rr.Radius.ui_points(0.6)
        self._log("bars/whiskers", rr.LineStrips2D(lines, radii=radii, colors=TEXT, draw_order=40.0))
        legend = f"{self._legend}\nthin line: 19 of 20 such operations end there"
        self._log("bars/legend", _labels(self._below, [legend], TEXT))

    def relaxation(self, energy: Energy, estimated_error: float) -> None:
        """Logs the energy by term and the error as its logarithm, after an increment."""
        values = {**energy.terms, "total": energy.total}
        if not self._terms:
            self._terms = [name for name, value in values.items() if value != 0.0 or name == "total"]
            names = [NAMES_OF_TERMS.get(name, name) for name in self._terms]
            colours = [*PLOTTED[: len(names) - 1], TOTAL]
            self._log(
                "energy", rr.SeriesLines(names=names, colors=colours, widths=[2.0] * len(names)), static=True
            )
        self._log("energy", rr.Scalars([values[name] for name in self._terms]))
        if 0.0 < estimated_error < math.inf:
            self._log("error", rr.Scalars(math.log10(estimated_error)))

    def _bars(self, angles: Angles, colour: tuple[int, int, int], place: int) -> Any:
        return rr.LineStrips2D(self._plot.bars(angles, place), radii=0.5 * BAR, colors=colour)

    def _labels(self, across: float, texts: Mapping[str, str], colour: tuple[int, int, int]) -> Any:
        """A text in the row of each level, at a part of the plot's width."""
        at = [[across * self._plot.width, self._plot.levels.index(level) - 0.55] for level in texts]
        return _labels(at, list(texts.values()), colour)


def _labels(at: list[list[float]], texts: list[str], colour: tuple[int, int, int]) -> Any:
    """Texts for what has a colour, each below its point."""
    return rr.Points2D(at, radii=0.0, colors=LABELS[colour], labels=texts, show_labels=True)


def apart(levels: Sequence[str], first: Sequence[str], rows: int) -> list[str]:
    """Levels whose labels do not lie on each other: at least `rows` apart, those that come `first` among them."""
    chosen: list[int] = []
    for place in [*map(levels.index, first), *range(len(levels))]:
        if all(abs(place - other) >= rows for other in chosen):
            chosen.append(place)
    return [levels[place] for place in sorted(chosen)]


def side_by_side(table: MeasureTable, before: TrunkMeasures, states: Sequence[str], load_factor: float) -> str:
    """The measures that a clinic asks for first, of now and of other states side by side, as Markdown."""
    shown_states = (BEFORE, "now", *states[1:])
    groups = measure_rows(table, before, shown_states)
    shown = [row for group in groups.values() for row in group if row.short]
    rows = [[f"{r.short[0].upper()}{r.short[1:]} [{r.quantity.unit}]", *r.cells()[1:]] for r in shown]
    head = ["", BEFORE, f"now, {100.0 * load_factor:.0f} %", *states[1:]]
    meaning = "Actual: the skin after surgery as it was scanned. " if ACTUAL in states else ""
    return f"{as_markdown(head, rows)}\n\n{meaning}{RESEARCH}"
