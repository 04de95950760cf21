"""How sure the numbers of a prediction are, as a summary keeps it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.io.file_access import read_text

WIDTH = 1.959964
"""Standard deviations to either side that hold 95 % of a normal distribution."""


@dataclass(frozen=True, kw_only=True)
class Band:
    """A number and how sure it is."""

    value: float
    """As predicted."""
    sd: float
    """Its standard deviation."""
    low: float
    """Where the interval begins that holds it in 19 of 20 cases ..."""
    high: float
    """... and where that ends."""
    linear: bool = True
    """Whether changes of the size of the errors act on it in proportion; where not (a point of contact of the
    dual tangent jumps to another fold, say), the deviation is that of draws, and the interval is rougher."""

    @classmethod
    def of(cls, value: float, sd: float, *, linear: bool = True) -> Band:
        """The band of a normal distribution."""
        return cls(value=value, sd=sd, low=value - WIDTH * sd, high=value + WIDTH * sd, linear=linear)


@dataclass(frozen=True, kw_only=True)
class BandSource:
    """One source of error."""

    name: str
    """The uncertain quantity."""
    spread: str
    """By how much: one standard deviation, in words."""
    reference: str
    """Where that comes from."""
    sd: dict[str, float]
    """Its own effect on each number, in the number's unit: `bsr T8`, `hump T9`, `shoulder difference`."""


@dataclass(frozen=True, kw_only=True)
class Bands:
    """How sure a prediction is, as surgery and films vary, and where the plan is carried out exactly."""

    bsr_deg: dict[str, Band]
    """Back surface rotation by level [degrees]."""
    max_hump_mm: Band | None
    """The largest hump [mm], at the level where it is predicted."""
    shoulder_difference_mm: Band | None
    """How much higher the right shoulder stands [mm]."""
    spine: dict[str, Band]
    """Measures of the planned spine alone by their name in the record of measures: `trunk_shift_mm`, or
    `cobb_deg T5-T12`, with the ends that the curve has before surgery."""
    exact: dict[str, Band]
    """The same numbers of the skin, by the names of the sources' `sd`, where surgery meets the plan and each
    landmark has the same error before and after: "this plan carried out exactly"."""
    sources: tuple[BandSource, ...]
    """The sources of error, the most important for back surface rotation first."""
    skin_mean_mm: float
    """Mean over the skin of the standard deviation of its places along the normal [mm]."""
    skin_max_mm: float
    """Its largest value [mm]."""
    draws: int
    """Draws of all errors at once by which the skin and the proportion were judged."""


def levels_in_band(bands: Bands, actual: Mapping[str, float | None]) -> dict[str, bool | None]:
    """Whether the actual rotation of each level [degrees] lies in its band; None where it is not known."""
    found = {level: actual.get(level) for level in bands.bsr_deg}
    return {
        level: None if angle is None else bands.bsr_deg[level].low <= angle <= bands.bsr_deg[level].high
        for level, angle in found.items()
    }


@dataclass(frozen=True, eq=False)
class FoundBands:
    """Bands of a prediction, and of every vertex of its skin."""

    bands: Bands
    """Those of the numbers."""
    skin_sd: np.ndarray
    """Standard deviation of the place of each vertex of the skin along its normal [mm], shape (vertices,)."""


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
