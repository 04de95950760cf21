"""The record of one case of a cohort, written beside its result when that is complete."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec

from warp_trunk.io.atomic_write import write_whole
from warp_trunk.measures.comparison import RANGES, BsrError, bsr_error
from warp_trunk.results.fingerprint import Fingerprint

JUDGED = "judged.json"
"""The file of a case's result that is written last: with it, the case needs nothing more."""
FAILED = "FAILED"
"""Status of a case without a result; every other one is a name of `RelaxStatus`."""
CONVERGED = "CONVERGED"
"""Status of the cases that count."""


@dataclass(frozen=True, kw_only=True)
class LevelRow:
    """Back surface rotation at one vertebra [degrees]; None where it is missing."""

    level: str
    """The vertebra."""
    before: float | None = None
    """Of the skin before surgery."""
    predicted: float | None = None
    """Of the predicted skin."""
    spline: float | None = None
    """Of the skin before surgery where the spline of the landmarks takes it, without any tissue."""
    actual: float | None = None
    """Of the actual skin."""
    in_band: bool | None = None
    """Whether the actual rotation lies in the band of the prediction; None where there is no band."""


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
    virtual: bool = False
    """Whether a computer made it."""
    cobb_deg: float | None = None
    """Largest curve before surgery [degrees]."""
    correction_percent: float | None = None
    """Part of it that is taken away, between the same vertebrae."""
    months_after: float | None = None
    """Months from surgery to the actual skin."""
    tets: int | None = None
    """Tetrahedra of its mesh."""
    hump_before_mm: float | None = None
    """Largest hump before surgery [mm], by its size, positive on the right."""
    hump_predicted_mm: float | None = None
    """The same, predicted."""
    hump_actual_mm: float | None = None
    """The same of the actual skin."""
    skin_distance_mm: float | None = None
    """Mean distance of the predicted back from the actual one [mm]."""
    levels: tuple[LevelRow, ...] = ()
    """Every vertebra, top to bottom."""
    warnings: int = 0
    """How many warnings its result has."""
    seconds: float | None = None
    """Duration [s]."""
    peak_memory_mb: float | None = None
    """Largest memory of its worker until then [MB]."""

    @property
    def counts(self) -> bool:
        """Whether statistics take it in: it converged, after surgery, and the actual skin is known."""
        known = any(level.actual is not None for level in self.levels)
        return self.status == CONVERGED and self.pose == "surgery" and known


@dataclass(frozen=True, kw_only=True)
class Judged:
    """A row, and what it depends on."""

    made_from: Fingerprint
    """Case, options and programs."""
    row: CaseRow
    """The row."""


def write_judged(folder: Path, judged: Judged) -> None:
    """Writes the record into a result folder, complete or not at all."""
    write_whole(folder / JUDGED, msgspec.json.format(msgspec.json.encode(judged), indent=2) + b"\n")


def read_judged(folder: Path) -> Judged | None:
    """The record of a result folder; None where there is none that can be read: the case is then done again."""
    try:
        return msgspec.json.decode((folder / JUDGED).read_bytes(), type=Judged)
    except (OSError, msgspec.MsgspecError, RecursionError):
        return None


Guess = Literal["predicted", "before", "spline"]
"""The guess that is compared with the actual skin: the prediction, "nothing changes", or "the spline carries
the skin"."""


@dataclass(frozen=True)
class LevelError:
    """One level of one case."""

    case: CaseRow
    """The case."""
    level: str
    """The vertebra."""
    guessed: float
    """The guess [degrees]."""
    actual: float
    """Actual rotation [degrees]."""
    in_band: bool | None
    """Whether the actual rotation lies in the band of the prediction."""

    @property
    def error(self) -> float:
        """Guessed less actual [degrees]."""
        return self.guessed - self.actual


def level_errors(rows: Sequence[CaseRow], of: str, guess: Guess = "predicted") -> list[LevelError]:
    """The errors of cases at the levels of a range of `RANGES` where all three guesses and the actual are known.

    Only those are taken, so that guesses are compared at the same places.
    """
    return [
        LevelError(row, level.level, getattr(level, guess), level.actual, level.in_band)
        for row in rows
        for level in row.levels
        if level.level in RANGES[of]
        and level.actual is not None
        and None not in (level.predicted, level.before, level.spline)
    ]


def case_error(row: CaseRow, of: str, guess: Guess = "predicted") -> BsrError | None:
    """The error of a case over a range as the papers give it: mean absolute and its standard deviation."""
    known = {one.level: (one.guessed, one.actual) for one in level_errors([row], of, guess)}
    return bsr_error(known, RANGES[of])
