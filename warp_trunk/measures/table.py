"""Tables as text for a terminal and as Markdown; and every measure of a skin as such tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .quantities import BEFORE, DETECTABLE, MeasureTable
from .rows import MISSING, measure_rows, number, sided

if TYPE_CHECKING:
    from .comparison import SkinComparison
    from .measures import TrunkMeasures

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


def measures_text(measures: TrunkMeasures) -> str:
    """Every measure of one skin: the whole trunk, then by level, then what is missing and why."""
    whole = [
        line
        for title, rows in measure_rows(MeasureTable.of({BEFORE: measures}), measures, (BEFORE,)).items()
        for line in ([title], *(row.cells() for row in rows))
    ]
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
            f"{DETECTABLE:g}° that can be detected; of the largest {error.of_maximum:+z.2f}°"
        )
    lines += ["", "Back surface rotation, predicted less actual [°]"]
    differences = [
        f"{level} {MISSING if value is None else f'{value:+z.1f}'}"
        for level, value in comparison.bsr_difference.items()
    ]
    lines += [", ".join(differences[first : first + 6]) for first in range(0, len(differences), 6)]
    distances = [
        [region, f"{found.area:.0f}", f"{found.signed_mean:+z.2f}"]
        + [f"{value:.2f}" for value in (found.mean, found.rms, found.p95, found.maximum)]
        + [f"{value:.2f}" for value in (found.symmetric_mean, found.symmetric_maximum)]
        if found
        else [region, *[MISSING] * 8]
        for region, found in comparison.distance.items()
    ]
    head = ["region", "area", "signed", "mean", "rms", "95 %", "max", "mean", "max"]
    return "\n".join(
        [
            *lines,
            "",
            "Distance from the prediction to the actual skin [mm], positive outside it; on the right both ways",
            as_text(head, distances),
            "Area in cm²; the flanks may hold the planes where the arms are cut off.",
        ]
    )
