"""The record of one case of a cohort, written beside its result when that is complete."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import msgspec

from warp_trunk.case.fingerprint import Fingerprint
from warp_trunk.io.atomic_write import json_text, write_whole
from warp_trunk.measures.quantities import ACTUAL, Measured, MeasureTable

JUDGED = "judged.json"
"""The file of a case's result that is written last: with it, the case needs nothing more."""
FAILED = "FAILED"
"""Status of a case without a result; every other one is a name of `RelaxStatus`."""
CONVERGED = "CONVERGED"
"""Status of the cases that count."""


@dataclass(frozen=True, kw_only=True)
class CaseRow:
    """One case of a cohort, simulated and judged, or the reason why not."""

    folder: str
    """Name of its folder, and of its result's."""
    status: str
    """Why its last relaxation ended, or `FAILED`."""
    reason: str = ""
    """Why it has no result, in one line."""
    case: str = ""
    """Its name."""
    patient: str = ""
    """Whose it is."""
    pose: str = "surgery"
    """The pose of the second scan: surgery or bending."""
    synthetic: bool = False
    """Whether a computer made it."""
    cobb_deg: float | None = None
    """Largest curve before surgery [degrees]."""
    correction_percent: float | None = None
    """Part of it that is taken away, between the same vertebrae."""
    months_after: float | None = None
    """Months from surgery to the actual skin."""
    tets: int | None = None
    """Tetrahedra of its mesh."""
    measures: tuple[Measured, ...] = ()
    """Every number of the states before, predicted, spline (the skin before surgery where the spline of the
    landmarks takes it, without any tissue), actual and error."""
    warnings: int = 0
    """How many warnings its result has."""
    seconds: float | None = None
    """Duration [s]."""
    peak_memory_mb: float | None = None
    """Largest memory of its worker until then [MB]."""

    @property
    def counts(self) -> bool:
        """Whether statistics take it in: it converged, after surgery, and the actual skin is known."""
        return self.status == CONVERGED and self.pose == "surgery" and self.judged

    @property
    def judged(self) -> bool:
        """Whether its actual back is known at any level, or without a spine its actual skin."""
        table = MeasureTable(self.measures)
        known = (*table.values(ACTUAL, "bsr_deg").values(), table.value("error", "distance_mean_mm"))
        return any(value is not None for value in known)


@dataclass(frozen=True, kw_only=True)
class Judged:
    """A row, and what it depends on."""

    made_from: Fingerprint
    """Case, options and programs."""
    row: CaseRow
    """The row."""


def write_judged(folder: Path, judged: Judged) -> None:
    """Writes the record into a result folder, complete or not at all."""
    write_whole(folder / JUDGED, json_text(judged))


def read_judged(folder: Path) -> Judged | None:
    """The record of a result folder; None where there is none that can be read: the case is then done again."""
    try:
        return msgspec.json.decode((folder / JUDGED).read_bytes(), type=Judged)
    except (OSError, msgspec.MsgspecError, RecursionError):
        return None
