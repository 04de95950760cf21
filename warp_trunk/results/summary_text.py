"""The end of a run in words and tables, for a terminal and for the viewer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from warp_trunk.io.folders import seen_from_here
from warp_trunk.measures import TrunkMeasures
from warp_trunk.measures.quantities import ACTUAL, BEFORE, PREDICTED, MeasureTable
from warp_trunk.measures.rows import RESEARCH, as_markdown, as_text, measure_rows, rotation_table, under_headings

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.engine.simulation import Increment

    from .result import Result
    from .summary import SpringSummary


def plain(result: Result, name: str = "") -> str:
    """The text at the end of a run: why it ended, the measures, and where the files are.

    `name` is that of one among several results; then every block begins with it.
    """
    of = f"{name}: " if name else ""
    folder, summary = result.folder, result.summary
    status = summary.status
    lines = [
        f"{of}{status.name}: {status.sentence}",
        *(f"{of}Warning: {warning}" for warning in summary.warnings),
        f"{summary.tets} tetrahedra, {summary.inverted_tets} of them inverted, "
        f"in {summary.seconds['total']:.1f} s",
    ]
    if summary.springs is not None:
        lines += spring_lines(summary.springs)
    lines += [
        f"{point.name} ({point.on}) moves by {point.distance:.1f} mm"
        + ("" if point.ratio is None else f", {point.ratio:.2f} of the way of {point.bone_point}")
        for point in summary.points
    ]
    lines += [f"{name}: {was:.1f} before, {will:.1f} predicted" for name, was, will in summary.chest_rows]
    rows = under_headings(measure_rows(result.table, result.measures_before))
    lines += ["", as_text([f"{of}measure", "before", "predicted"], rows)]
    if summary.has_spine:
        lines += ["", f"{of}Rotation of the back (BSR) at every vertebra, with the side that stands further back"]
        bands = any(row.low is not None for row in result.table.column(PREDICTED, "bsr_deg").values())
        states = [BEFORE, PREDICTED, *([ACTUAL] if summary.has_actual else [])]
        head = ["level [°]", *states, *(["19 of 20"] if bands else [])]
        lines.append(as_text(head, rotation_table(result.table, states, bands=bands)))
    files = sorted(path.name for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))
    return "\n".join([*lines, "", f"{of}Written to {seen_from_here(folder)}: {', '.join(files)}", RESEARCH])


def spring_lines(springs: SpringSummary) -> list[str]:
    """The constants and energies of eq. 4.6, in two lines."""
    terms = {"E_G": springs.gravity, "E_D": springs.distance, "E_A": springs.area, "E_V": springs.volume}
    energies = [f"{name} {value:.6g}" for name, value in terms.items() if value is not None]
    return [
        f"Eq. 4.6: epsilon {springs.epsilon:g}, theta {springs.theta:g}, alpha {springs.alpha:.4g}; "
        f"k_D {springs.k_d_joule:.4g} J, M_0 {springs.mean_mass_kg:.4g} kg, H_0 {springs.height_m:.4g} m",
        f"Energies: {', '.join(energies)}; W {springs.total:.6g}",
    ]


def markdown(
    case: Case, last: Increment, before: TrunkMeasures, after: TrunkMeasures, warnings: Sequence[str]
) -> str:
    """The same for the viewer, which reads Markdown."""
    status, table = last.relaxation.status, MeasureTable.of({BEFORE: before, PREDICTED: after})
    lines = [f"# {case.name}", "", f"**{status.name}**: {status.sentence}.", ""]
    lines += [line for warning in warnings for line in (f"**Warning:** {warning}", "")]
    lines += [as_markdown(["measure", "before", "predicted"], under_headings(measure_rows(table, before))), ""]
    if before.bsr:
        head = ["rotation of the back [°] at", "before", "predicted"]
        lines += [as_markdown(head, rotation_table(table)), ""]
    return "\n".join([*lines, RESEARCH])
