"""The trunk in numbers: rotations by level as bars, energy and error as plots, a table of the summary."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from warp_trunk.measures.rows import measure_rows
from warp_trunk.measures.table import RESEARCH, as_markdown

from . import drawing

if TYPE_CHECKING:
    from warp_trunk.engine.relaxation import Energy
    from warp_trunk.measures import TrunkMeasures
    from warp_trunk.results.bands import Band

    from .scene import Log

TERMS = {
    "distance": ("edges", drawing.NOW),
    "area": ("faces", (230, 159, 0)),
    "shape": ("shape", drawing.NOW),
    "volume": ("volume", (0, 158, 115)),
    "gravity": ("gravity", (204, 121, 167)),
    "total": ("total", drawing.TEXT),
}
"""Name and colour of a term of an energy in the plot; edges and shape belong to different energies."""
OTHER = (240, 228, 66)
"""Colour of a term that has none."""
BELOW_BARS, ABOVE_BARS = 10.0, 40.0
"""Where whiskers lie in the order of drawing: along their bars beneath these, so that both are seen."""


class Numbers:
    """Logs measures and relaxations; the levels are known by their names."""

    def __init__(
        self, log: Log, before: TrunkMeasures, target: TrunkMeasures, target_name: str, *, whiskers: bool = False
    ) -> None:
        """Logs what never changes; the target's measures stand beside those of before and now, with room for
        `whiskers` where there will be some."""
        import rerun as rr

        self._rr, self._log = rr, log
        self._before, self._target, self._target_name = before, target, target_name
        self._plot = plot = drawing.BarPlot.of(before.bsr, target.bsr, spare=drawing.SPARE if whiskers else 0.0)
        self._terms: list[str] = []
        log("error", rr.SeriesLines(names="error", colors=drawing.NOW, widths=2.0), static=True)
        log("bsr", rr.SeriesLines(names=list(before.bsr)), static=True)
        log("bars/before", self._bars(before, drawing.BEFORE, 0), static=True)
        log("bars/target", self._bars(target, drawing.TARGET, 2), static=True)
        rows = len(plot.levels)
        zero = rr.LineStrips2D([[[plot.zero, -0.7], [plot.zero, rows - 0.3]]], colors=drawing.TEXT)
        log("bars/zero", zero, static=True)
        names = {level: level for level in plot.levels}
        self._labels("bars/levels", drawing.NAMES, names, drawing.TEXT, static=True)
        legend = rr.Points2D(
            [[0.5 * plot.width, rows - 0.3], [0.5 * plot.width, rows + 0.9]],
            radii=0.0,
            colors=drawing.TEXT,
            labels=["to the right: right side further back", f"grey before, blue now, orange {target_name}"],
            show_labels=True,
        )
        log("bars/legend", legend, static=True)

    def measures(self, now: TrunkMeasures, load_factor: float) -> None:
        """Logs rotations and the table."""
        rr = self._rr
        self._log("bars/now", self._bars(now, drawing.NOW, 1))
        angles = {level: drawing.degrees(angle) for level, angle in now.bsr.items()}
        self._labels("bars/angles", drawing.ANGLES, angles, drawing.NOW)
        self._log("bsr", rr.Scalars([math.nan if angle is None else angle for angle in now.bsr.values()]))
        text = table(self._before, now, self._target, self._target_name, load_factor)
        self._log("table", rr.TextDocument(text, media_type="text/markdown"))

    def bands(self, bands: Mapping[str, Band]) -> None:
        """Logs how sure the rotations at the end are, as whiskers over their bars."""
        ranges = {level: (band.low, band.high) for level, band in bands.items()}
        lines = self._plot.whiskers(ranges)
        along = [bool(line[0, 1] == line[1, 1]) for line in lines]
        for part, over, wanted in (("along", BELOW_BARS, True), ("ends", ABOVE_BARS, False)):
            strips = [line for line, is_along in zip(lines, along, strict=True) if is_along is wanted]
            for layer, (width, colour) in enumerate(drawing.WHISKER):
                radii = self._rr.Radius.ui_points(0.5 * width)
                drawn = self._rr.LineStrips2D(strips, radii=radii, colors=colour, draw_order=over + layer)
                self._log(f"bars/whiskers/{part}/{layer}", drawn)

    def relaxation(self, energy: Energy, estimated_error: float, linear_iterations: int) -> None:
        """Logs the energy by term, the error as its logarithm, and the work, after an increment or a step."""
        rr = self._rr
        values = {**energy.terms, "total": energy.total}
        if not self._terms:
            self._terms = [name for name, value in values.items() if value != 0.0 or name == "total"]
            names, colours = zip(*(TERMS.get(name, (name, OTHER)) for name in self._terms), strict=True)
            lines = rr.SeriesLines(names=list(names), colors=list(colours), widths=[2.0] * len(names))
            self._log("energy", lines, static=True)
        self._log("energy", rr.Scalars([values[name] for name in self._terms]))
        if 0.0 < estimated_error < math.inf:
            self._log("error", rr.Scalars(math.log10(estimated_error)))
        self._log("linear_iterations", rr.Scalars(float(linear_iterations)))

    def _bars(self, measures: TrunkMeasures, colour: tuple[int, int, int], place: int) -> Any:
        lines = self._plot.bars(measures.bsr, place)
        return self._rr.LineStrips2D(lines, radii=0.5 * drawing.BAR, colors=colour)

    def _labels(
        self,
        path: str,
        across: float,
        texts: Mapping[str, str],
        colour: tuple[int, int, int],
        *,
        static: bool = False,
    ) -> None:
        """A text in the row of each level, at a part of the plot's width."""
        rows = [self._plot.levels.index(level) for level in texts]
        labels = self._rr.Points2D(
            [[across * self._plot.width, row - 0.55] for row in rows],  # a label hangs below its point
            radii=0.0,
            colors=colour,
            labels=list(texts.values()),
            show_labels=True,
        )
        self._log(path, labels, static=static)


def table(
    before: TrunkMeasures, now: TrunkMeasures, target: TrunkMeasures, target_name: str, load_factor: float
) -> str:
    """The measures that a clinic asks for first, side by side, as Markdown."""
    meaning = {
        "actual": "Actual: the skin after surgery as it was scanned.",
        "target": "Target: the planned bones, with the skin where their path alone carries it.",
    }
    groups = measure_rows([before, now, target])
    rows = [row.cells() for group in groups.values() for row in group if row.short or row.values[0] is None]
    head = ["", "before", f"now, {100.0 * load_factor:.0f} %", target_name]
    return f"{as_markdown(head, rows)}\n\n{meaning[target_name]} {RESEARCH}"
