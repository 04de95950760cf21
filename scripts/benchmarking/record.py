"""One measured point: how long a setting takes and how far from the truth it ends."""

import json
import os
import platform
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from warp_trunk import InputError, system
from warp_trunk.engine.energies.by_name import EnergyName


@dataclass(frozen=True, kw_only=True)
class Setting:
    """By what a curve is made."""

    method: str
    """newton, gradient or scipy-lbfgsb."""
    threads: int
    """CPU threads; 1 on CUDA."""
    precision: str
    """float32 or float64."""
    device: str
    """cpu or cuda:N."""
    energy: EnergyName = "itmsm"
    """Energy of the tissue."""
    bones: str = "spline"
    """How bones are carried: spline or follow."""


@dataclass(frozen=True, kw_only=True)
class Record(Setting):
    """One point of a curve of error against time."""

    tets: int
    """Tetrahedra of the mesh."""
    increments: int
    """Parts in which the correction was applied."""
    tolerance_mm: float | None
    """Asked for at the end [mm]; ten times as much before. None where a method knows no such thing."""
    max_steps: int
    """Most steps allowed for each increment."""
    seconds: float
    """All increments, after set-up; the least of a few runs where they are short."""
    max_error_mm: float
    """Largest distance of a node from the truth [mm]."""
    mean_skin_error_mm: float
    """Mean distance of a skin vertex from the truth [mm]."""
    bsr_error_deg: float
    """Largest error of the back surface rotation of any level [degrees]."""
    estimated_error_mm: float | None
    """Largest distance from equilibrium as the run itself estimates it [mm]."""
    status: str
    """How the last increment ended."""
    steps: int
    """Accepted steps, all increments."""
    linear_iterations: int
    """Iterations of the linear solver, all increments."""
    evaluations: int
    """Evaluations of energy and gradient, all increments."""
    peak_memory_mb: float
    """Highest memory so far of the process, which measures this curve alone; on CUDA, of the device's pool."""
    setup_seconds: float
    """Model, preconditioner and recorded launches of a warm process."""
    compile_seconds: float | None
    """Compilation of all kernels of the precision and device from an empty cache."""
    hardware: str
    """Processor or accelerator."""
    versions: dict[str, str]
    """Of what matters to speed."""


def peak_memory(device: str) -> float:
    """Highest use so far [MB, 1e6 bytes]: of the process on the CPU, of the memory pool on CUDA."""
    if device != "cpu":
        return wp.get_mempool_used_mem_high(device) / 1e6
    return system.peak_memory(children=False)


def hardware(device: str) -> str:
    """The name of the accelerator, or of the processor with the cores this process may use."""
    if device != "cpu":
        return wp.get_device(device).name
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.machine()}, {system.usable_cores()} cores"


def versions() -> dict[str, str]:
    """Python, numpy, warp and warp_trunk."""
    by_package = {"python": platform.python_version(), "numpy": np.__version__, "warp": wp.config.version}
    try:
        by_package["warp_trunk"] = metadata.version("warp-trunk")
    except metadata.PackageNotFoundError:  # run from a checkout that is not installed
        by_package["warp_trunk"] = "checkout"
    return by_package


def write_records(path: str | Path, records: Iterable[Record]) -> None:
    """Writes benchmark.json, whole or not at all; NaN is not JSON and refused."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    making = path.with_suffix(".making")
    making.write_text(
        json.dumps([asdict(record) for record in records], indent=1, allow_nan=False) + "\n",
        encoding="utf-8",
        newline="\n",
    )
    os.replace(making, path)


def read_records(path: str | Path) -> list[Record]:
    """The records of a file.

    Raises:
        InputError: the file is missing or holds something else.
    """
    try:
        stored: list[dict[str, Any]] = json.loads(Path(path).read_text(encoding="utf-8"))
        return [Record(**record) for record in stored]
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"{path}: cannot be read as records of 'run' ({error})") from error
