"""One line of the comparison: what one peer took for one problem, and how far from this program it ends."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from .task import Run


@dataclass(frozen=True, kw_only=True)
class Row:
    """A peer on a problem."""

    problem: str
    """What is solved."""
    tets: int
    """Tetrahedra of the mesh."""
    free_nodes: int
    """Nodes that relax."""
    peer: str
    """As the registry names it."""
    law: str
    """Which of the strain energies of `finite_elements.neo_hookean`."""
    favour: str
    """How it was favoured."""
    version: str = ""
    """Of the package, and of its solver."""
    runs: tuple[Run, ...] = ()
    """Its ways; none where there is no answer."""
    apart_mm: float | None = None
    """Largest distance of a node of its end, not stopped, from this program's in float64; where its law is another
    one, of that law's equilibrium; None where its end was not waited for."""
    why_not: str = ""
    """Why there is no answer."""
    hardware: str
    """Processor, and cores."""
    others: float | None = None
    """Cores that other programs kept busy meanwhile, on average; None where that was not measured."""

    def best(self, accuracy: float) -> Run | None:
        """The way that solves fastest, of those near enough; of all the nearest, where none is."""
        near = [run for run in self.runs if run.error_mm <= accuracy]
        return min(near, key=lambda run: run.seconds, default=None) or min(
            self.runs, key=lambda run: run.error_mm, default=None
        )


def write_rows(path: Path, rows: Iterable[Row]) -> None:
    """As JSON, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    making = path.with_suffix(".making")
    making.write_text(json.dumps([asdict(row) for row in rows], indent=1, allow_nan=False) + "\n")
    os.replace(making, path)


def read_rows(path: Path) -> list[Row]:
    """What `write_rows` wrote."""
    stored: list[dict[str, Any]] = json.loads(path.read_text())
    return [Row(**{**row, "runs": tuple(Run(**run) for run in row["runs"])}) for row in stored]
