"""How sure the numbers of a prediction are, as a summary keeps it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.io.file_access import read_text
from warp_trunk.measures.quantities import Measured, MeasureTable


@dataclass(frozen=True, kw_only=True)
class BandSource:
    """One source of error."""

    name: str
    """The uncertain quantity."""
    spread: str
    """By how much: one standard deviation, in words."""
    reference: str
    """Where that comes from."""
    sd: dict[str, dict[str, float]]
    """Its own effect on each number of the skin, by quantity and level, in the unit of the quantity."""


@dataclass(frozen=True, kw_only=True)
class Bands:
    """Sources of the intervals of a prediction; the intervals themselves are in the table of measures."""

    sources: tuple[BandSource, ...]
    """The sources of error, the most important for back surface rotation first."""
    nonlinear: tuple[tuple[str, str], ...]
    """Quantity and level of the numbers on which changes of the size of the errors do not act in proportion (a
    point of contact of the dual tangent jumps to another fold, say): their deviation is that of draws, and the
    interval is rougher."""
    skin_mean_mm: float
    """Mean over the skin of the standard deviation of its places along the normal [mm]."""
    skin_max_mm: float
    """Its largest value [mm]."""
    draws: int
    """Draws of all errors at once by which the skin and the proportion were judged."""


@dataclass(frozen=True, eq=False)
class FoundBands:
    """Intervals of a prediction, and of every vertex of its skin."""

    rows: tuple[Measured, ...]
    """Numbers with their interval: predicted, and `exact` where surgery meets the plan and each landmark has the
    same error before and after ("this plan carried out exactly"; numbers of the skin alone)."""
    bands: Bands
    """Their sources."""
    skin_sd: np.ndarray
    """Standard deviation of the place of each vertex of the skin along its normal [mm], shape (vertices,)."""

    @property
    def table(self) -> MeasureTable:
        """The rows, by state, quantity and level."""
        return MeasureTable(self.rows)


def write_skin_sd(path: Path, skin_sd: np.ndarray) -> None:
    """Writes the deviation of every vertex, a line each, in the order of predicted_skin.ply."""
    np.savetxt(path, skin_sd, fmt="%.4f", header="sd_mm", comments="")


def read_skin_sd(path: Path, vertices: int) -> np.ndarray:
    """The deviation of every vertex [mm], shape (vertices,).

    Raises:
        InputError: there is no such file, or it has not one number for each vertex.
    """
    lines = read_text(path, "a result with bands has it").splitlines()[1:]
    try:
        values = np.array(lines, dtype=np.float64)
    except ValueError:
        values = np.full(1, np.nan)
    if values.shape != (vertices,) or not np.isfinite(values).all():
        raise InputError(f"{path}: must have one number for each of {vertices} vertices; simulate the case again")
    return values
