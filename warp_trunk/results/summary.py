"""The content of summary.json: one record, written and read here and nowhere else.

A field of `Summary` is an entry of the file under the same name, and its type is what is accepted when the file is
read. A field that older results lack has a default.
"""

from __future__ import annotations

import platform
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from warp_trunk.case.folders import other_kind
from warp_trunk.case.uncertainty import Invented
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.tissue import Tissue
from warp_trunk.io.atomic_write import json_text
from warp_trunk.io.records import read_json
from warp_trunk.io.result_files import SUMMARY
from warp_trunk.measures.body_part import CHEST_LABELS, ChestIndices, FollowedPoint
from warp_trunk.measures.quantities import ACTUAL, Measured
from warp_trunk.measures.skin_quality import SkinQuality
from warp_trunk.spine import CobbAngle

from .bands import Bands

Terms = dict[str, float | None]
"""Energy by term, and their `total`."""


@dataclass(frozen=True, kw_only=True)
class StepSummary:
    """One accepted step of a relaxation."""

    energy: Terms
    """After it."""
    estimated_error_mm: float | None
    """Estimated largest distance of a node from its equilibrium [mm]."""
    step_length: float
    """Fraction of the proposed direction that was taken."""
    linear_iterations: int
    """Iterations of the linear solver."""
    seconds: float
    """From the start of the relaxation to its end [s]."""


@dataclass(frozen=True, kw_only=True)
class IncrementSummary:
    """One increment of the correction and the relaxation at its end."""

    load_factor: float
    """Fraction of the correction that is applied, in (0, 1]."""
    status: RelaxStatus
    """Why the relaxation ended."""
    energy: Terms
    """At its end."""
    steps: int
    """Accepted steps."""
    linear_iterations: int
    """Iterations of the linear solver."""
    estimated_error_mm: float | None
    """Estimated largest distance of a node from its equilibrium at the end [mm]."""
    seconds: float
    """Duration [s]."""
    history: tuple[StepSummary, ...]
    """Every step in order."""


@dataclass(frozen=True, kw_only=True)
class SpringSummary:
    """The constants and energies of eq. 4.6 of [2] at the end; energies are without unit, as there."""

    epsilon: float
    """k_A / k_D."""
    theta: float
    """k_V / k_D."""
    alpha: float
    """2 g M_0 H_0 / k_D; 0 without gravity."""
    k_d_joule: float
    """k_D [J], the stiffness of an edge."""
    mean_mass_kg: float
    """M_0 [kg], the mean mass of a tetrahedron."""
    height_m: float
    """H_0 [m], the height of the trunk."""
    gravity: float | None
    """E_G, eq. 4.7, with the sign of physics; None without gravity."""
    distance: float
    """E_D, eq. 4.8."""
    area: float | None
    """E_A, eq. 4.9; None without its term."""
    volume: float | None
    """E_V, eq. 4.10; None without its term."""
    total: float
    """W, their sum with alpha, epsilon and theta, and the bending of the skin; times k_D / 2 it is in J."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Summary:
    """How a run ended, with which options, and what was measured; a number that is not known is None."""

    case: str
    """Name of the case."""
    status: RelaxStatus
    """Why the last relaxation ended."""
    tets: int
    """Tetrahedra of the mesh."""
    nodes: int
    """Nodes of the mesh."""
    free_nodes: int
    """Nodes that are not on bone."""
    inverted_tets: int
    """Tetrahedra without positive volume at the end."""
    device: str
    """Device of the computation."""
    precision: str
    """float32 or float64."""
    parameters: dict[str, Any]
    """Every option of the run by its own name."""
    sag_mm: float
    """Largest distance of a node at rest from where the scan has it [mm]; 0 without gravity."""
    tissues: tuple[Tissue, ...]
    """Materials of the trunk."""
    terms: tuple[str, ...]
    """Terms of the energy."""
    increments: Annotated[tuple[IncrementSummary, ...], msgspec.Meta(min_length=1)]
    """Increments in order."""
    measures: tuple[Measured, ...]
    """Every measured number: a table of state, level, quantity, value and interval."""
    curves: dict[str, tuple[CobbAngle, ...]]
    """Curves of the spine by state, before and predicted (as planned), top to bottom, each between the vertebrae
    that end it then."""
    seconds: dict[str, float | None]
    """Time [s] by stage of the run."""
    peak_memory_mb: float | None
    """Largest resident memory [MB]."""
    versions: dict[str, str | None]
    """Versions of this program and of the libraries on which its numbers depend."""
    lenke: str = ""
    """Curve type by Lenke before surgery, such as 1A; empty without a thoracic or lumbar curve."""
    released_nodes: int = 0
    """Nodes that came off the bones at the end, because tetrahedra there were inside out."""
    warnings: tuple[str, ...] = ()
    """Reasons to doubt the result, a sentence each."""
    skin_quality: SkinQuality | None = None
    """Worst stretch and fold of the predicted skin."""
    day: str = ""
    """Day on which it was simulated, such as 2026-11-28."""
    synthetic: bool = False
    """Whether the trunk is synthetic."""
    bands: Bands | None = None
    """The sources of the 95 % intervals of the measures; None without `--bands`."""
    springs: SpringSummary | None = None
    """Eq. 4.6, where the energy is itmsm."""
    points: tuple[FollowedPoint, ...] = ()
    """How far the points of the case move."""
    invented: Invented | None = None
    """The parts of the case that were not measured."""
    chest: tuple[ChestIndices, ChestIndices] | None = None
    """Indices of the chest before and as predicted, where they are measured."""

    def __repr__(self) -> str:
        return f"Summary({self.case!r}, {self.status}, {self.tets} tetrahedra, {len(self.measures)} numbers)"

    @property
    def has_spine(self) -> bool:
        """Whether the back was measured at vertebrae."""
        return any(row.quantity == "bsr_deg" for row in self.measures)

    @property
    def chest_rows(self) -> list[tuple[str, float, float]]:
        """Label, value before and as predicted of each index of the chest."""
        if self.chest is None:
            return []
        was, will = map(vars, self.chest)
        return [(label, was[name], will[name]) for name, label in CHEST_LABELS.items()]

    @property
    def has_actual(self) -> bool:
        """Whether the actual skin after surgery is known."""
        return any(row.state == ACTUAL for row in self.measures)


def as_read(summary: Summary) -> Summary:
    """The summary as a reader of its file gets it: NaN and infinity are None, numbers of NumPy those of Python."""
    return msgspec.json.decode(msgspec.json.encode(summary, enc_hook=_plain), type=Summary)


def write_summary(path: Path, summary: Summary) -> None:
    """Writes it as JSON."""
    path.write_bytes(json_text(summary, _plain))


def read_summary(folder: str | Path) -> Summary:
    """The summary of a result folder.

    Raises:
        InputError: there is none, or none yet, or it is damaged or of another version of the program.
    """
    folder = Path(folder)
    path, expected = folder / SUMMARY, "give a folder that `simulate` wrote"
    if not path.exists():
        expected = other_kind(folder, "result") or expected
    fault = "was changed by hand or written by another version of the program"
    return read_json(path, Summary, expected, fault, "simulate the case again")


def _plain(value: object) -> object:
    """The JSON value of a NumPy number; of other objects, such as a path among the options, the text."""
    return value.item() if isinstance(value, np.generic) else str(value)


PACKAGES = ("warp-trunk", "warp-lang", "numpy", "scipy", "tetgen", "trimesh", "rerun-sdk")


def versions() -> dict[str, str | None]:
    """Version by name; None for a package that is not installed."""
    of_system = {"python": platform.python_version(), "platform": platform.platform()}
    return {**of_system, **{package: version_of(package) for package in PACKAGES}}


def version_of(package: str) -> str | None:
    """The version of a package; None where it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
