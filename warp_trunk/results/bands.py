"""How sure the numbers of a prediction are, as a summary keeps it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.io.file_access import read_text
from warp_trunk.measures import TrunkMeasures
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
class Effects:
    """Effects of the errors on the numbers of a prediction, with their signs: two plans for one patient share the
    errors, so that much of them cancels in the difference of two predictions."""

    names: np.ndarray
    """Quantity and level of each number, shape (numbers, 2)."""
    sources: np.ndarray
    """Names of the sources of error but for the landmarks, shape (sources,)."""
    effects: np.ndarray
    """Change of each number by one standard deviation of each source, shape (numbers, sources)."""
    landmarks: np.ndarray
    """Change of each number by one standard deviation of each coordinate of a landmark, before surgery and after,
    shape (numbers, coordinates)."""
    ratio: np.ndarray
    """Deviation of each number in draws over that by its derivatives, shape (numbers,)."""
    likely_worse: np.ndarray
    """Mean displacement of the predicted skin where its hump is at the upper end of its 80 % interval [mm], shape
    (vertices, 3); the opposite is as likely."""

    def difference_sd(self, other: Effects) -> dict[tuple[str, str], float]:
        """The standard deviation of the difference of each number between two plans that share all errors."""
        row_of = {tuple(name): row for row, name in enumerate(other.names.tolist())}
        every = sorted({*self.sources.tolist(), *other.sources.tolist()})
        sds = {}
        for mine, name in enumerate(self.names.tolist()):
            row = row_of.get(tuple(name))
            if row is None or self.landmarks.shape[1] != other.landmarks.shape[1]:
                continue
            own_effects, other_effects = (
                plan.ratio[at] * np.append(_by_source(plan, at, every), plan.landmarks[at])
                for plan, at in ((self, mine), (other, row))
            )
            sds[name[0], name[1]] = float(np.linalg.norm(own_effects - other_effects))
        return sds


def _by_source(effects: Effects, row: int, sources: Sequence[str]) -> list[float]:
    by_source = dict(zip(effects.sources.tolist(), effects.effects[row].tolist(), strict=True))
    return [by_source.get(source, 0.0) for source in sources]


def write_effects(path: Path, effects: Effects) -> None:
    """Write effects as arrays of NumPy."""
    with path.open("wb") as file:
        arrays = {field.name: np.asarray(getattr(effects, field.name)) for field in fields(effects)}
        small: dict[str, Any] = {
            name: array.astype("f4") if array.dtype.kind == "f" else array for name, array in arrays.items()
        }
        np.savez_compressed(file, **small)


def read_effects(path: Path, vertices: int) -> Effects:
    """Effects from their file.

    Raises:
        InputError: there is no such file, or it is damaged or of another skin.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            effects = Effects(**{field.name: file[field.name] for field in fields(Effects)})
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise InputError(f"{path}: cannot be read ({error}); simulate the case again") from error
    if effects.likely_worse.shape != (vertices, 3):
        raise InputError(f"{path}: must have a row for each of {vertices} vertices; simulate the case again")
    return effects


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
    effects: Effects
    """Effects of the errors, for comparisons."""
    likely: dict[str, TrunkMeasures]
    """The skin with a hump at either end of its 80 % interval, measured at the level of that hump, by state."""

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
