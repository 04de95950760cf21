"""The comparison as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from .other_work import BUSY
from .registry import OURS
from .rows import Row

HEAD = (
    "| | set-up [s] | solve [s] | true error [mm] | after set-up | with set-up | its end from ours [mm] | how |\n"
    "|---|---|---|---|---|---|---|---|\n"
)


def markdown(rows: Sequence[Row], accuracy: float) -> str:
    """One table for each problem, ratios to this program's row in it."""
    parts = []
    for (problem, tets, free), group in groupby(rows, key=lambda row: (row.problem, row.tets, row.free_nodes)):
        of_problem = list(group)
        parts.append(f"{problem}, {tets:,} tetrahedra, {free:,} free nodes; {_machine(of_problem)}:\n\n{HEAD}")
        parts.extend(_line(row, of_problem, accuracy) for row in of_problem)
        parts.append("\n")
    return "".join(parts).rstrip("\n") + "\n"


def ratios(row: Row, ours: Row, accuracy: float) -> tuple[float, float] | None:
    """How many times as long a peer takes after set-up and with it, by the least time of each; None where it has
    no answer that is near enough."""

    def least(of: Row) -> tuple[float, float]:
        near = [run for run in of.runs if run.error_mm <= accuracy]
        return min(run.seconds for run in near), min(run.seconds + run.setup_seconds for run in near)

    if any(not [run for run in of.runs if run.error_mm <= accuracy] for of in (row, ours)):
        return None
    (after, whole), (our_after, our_whole) = least(row), least(ours)
    return after / our_after, whole / our_whole


def _machine(rows: list[Row]) -> str:
    """Where it was measured, and whether that was busy with something else."""
    others = max((row.others for row in rows if row.others is not None), default=0.0)
    return rows[0].hardware + (f", other programs kept {others:.1f} cores busy" if others > BUSY else "")


def _line(row: Row, of_problem: list[Row], accuracy: float) -> str:
    run = row.best(accuracy)
    if run is None:
        return f"| {row.peer} | | | | | | | {row.why_not} |\n"
    ours = next((other for other in of_problem if other.peer == OURS), None)
    found = ratios(row, ours, accuracy) if ours and row is not ours else None
    after, whole = (f"{ratio:.1f}" for ratio in found) if found else ("", "")
    apart = "" if row.apart_mm is None else f"{row.apart_mm:.1g}"
    if row.law != of_problem[0].law:
        apart += " (its law)"
    return (
        f"| {row.version or row.peer} | {run.setup_seconds:.2f} | {run.seconds:.2f} | {run.error_mm:.1g} | "
        f"{after} | {whole} | {apart} | {run.way}: {row.favour} |\n"
    )
