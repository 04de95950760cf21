"""The end of a run in words and a table, for a terminal and for the viewer."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.measures import CobbAngle, TrunkMeasures
from warp_trunk.measures.cobb import curves_after

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.engine.simulation import Increment

    from .result import Result
    from .summary import Summary

RESEARCH = "A research simulation, not for clinical use."


def plain(result: Result, name: str = "") -> str:
    """What is printed at the end: why it ended, what changed, and where the files are.

    `name` is that of one among several results; then every block begins with it.
    """
    of = f"{name}: " if name else ""
    folder, summary = result.folder, result.summary
    status, bsr = summary.ending, summary.bsr_deg
    lines = [
        f"{of}{status.name}: {status.value}",
        *(f"{of}Warning: {warning}" for warning in summary.warnings),
        f"{summary.tets} tetrahedra, {summary.inverted_tets} of them inverted, "
        f"in {summary.seconds['total']:.1f} s",
        _skin(result.measures),
    ]
    lines += [
        f"{point.name} ({point.on}) moves by {np.linalg.norm(point.way):.1f} mm"
        + ("" if point.ratio is None else f", {point.ratio:.2f} of the way of {point.bone_point}")
        for point in summary.points
    ]
    lines += [f"{name}: {was:.1f} before, {will:.1f} predicted" for name, (was, will) in summary.chest.items()]
    if bsr.before:
        lines += _rotations(of, summary, result.measures_before)
    lines += ["", f"{of}Written to {folder}: {', '.join(sorted(_files(folder)))}", RESEARCH]
    return "\n".join(lines)


def _rotations(of: str, summary: Summary, before: TrunkMeasures) -> list[str]:
    """The curves of the spine, and the rotation of the back at each level."""
    bsr, bands = summary.bsr_deg, {} if summary.bands is None else summary.bands.bsr_deg
    lines = [
        f"Cobb angles: {_curves(before.cobb, summary.cobb_deg.followed)}",
        "",
        f"{of}Back surface rotation (BSR): how far the back is turned at the height of each vertebra [degrees];",
        "positive: the right side stands further back",
        "level  before   after"
        + ("  actual" if bsr.actual else "")
        + ("   after, 19 of 20 between" if bands else ""),
    ]
    for level in bsr.before:
        cells = [bsr.before[level], bsr.after.get(level)]
        cells += [bsr.actual.get(level)] if bsr.actual else []
        band = f"{bands[level].low:>+z10.1f} and {bands[level].high:+z.1f}" if level in bands else ""
        lines.append(f"{level:<5}" + "".join(f"{_number(cell):>8}" for cell in cells) + band)
    return lines


def markdown(
    case: Case, last: Increment, before: TrunkMeasures, after: TrunkMeasures, warnings: Sequence[str]
) -> str:
    """The same for the viewer, which reads Markdown."""
    status = last.relaxation.status
    return "\n".join(
        [
            f"# {case.name}",
            "",
            f"**{status.name}**: {status.value}.",
            "",
            *(line for warning in warnings for line in (f"**Warning:** {warning}", "")),
            _skin(after),
            "",
            *(_rotations_markdown(case, before, after) if before.bsr else ()),
            RESEARCH,
        ]
    )


def _rotations_markdown(case: Case, before: TrunkMeasures, after: TrunkMeasures) -> list[str]:
    rows = [
        f"| {level} | {_number(angle)} | {_number(after.bsr.get(level))} |" for level, angle in before.bsr.items()
    ]
    return [
        f"Cobb angles: {_curves(before.cobb, curves_after(before.cobb, case.planned_landmarks))}.",
        "",
        "Back surface rotation (BSR): how far the back is turned at the height of each vertebra, in degrees; "
        "positive: the right side stands further back.",
        "",
        "| level | before | after |",
        "|---|---:|---:|",
        *rows,
        "",
    ]


def _skin(after: TrunkMeasures) -> str:
    return f"The skin moves by up to {after.skin_change_max:.1f} mm, {after.skin_change_mean:.1f} mm on average."


def _curves(curves: Sequence[CobbAngle], after: Sequence[float | None]) -> str:
    """Each curve before surgery and as planned, between the same two vertebrae, as the report has it."""
    named = [
        f"{curve.angle:.0f}° to {'?' if angle is None else f'{angle:.0f}°'}, {curve.upper} to {curve.lower}, "
        f"convex to the {curve.convex}"
        for curve, angle in zip(curves, after, strict=True)
    ]
    return "; ".join(named) or "none of 10° or more before surgery"


def _number(angle: float | None) -> str:
    """An angle [degrees] with its sign; 'missing' where the plane missed the trunk."""
    return "missing" if angle is None else f"{angle:+z.1f}"


def _files(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if path.is_file() and not path.name.startswith(".")]
