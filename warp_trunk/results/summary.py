"""What a summary says: how the run ended, with which options, and what was measured."""

from __future__ import annotations

import dataclasses
import math
import platform
import sys
from collections.abc import Mapping, Sequence
from importlib import metadata
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.engine.model import Model
    from warp_trunk.engine.relaxation import RelaxStep
    from warp_trunk.engine.simulation import Increment
    from warp_trunk.engine.state import Energy
    from warp_trunk.engine.trunk_mesh import TrunkMesh
    from warp_trunk.measures import TrunkMeasures

STAGES = ("load", "surface", "mesh", "compile", "relax", "record", "total")
"""The parts of every run, whose seconds a summary gives."""
SCENE_STAGES = ("layers", "rest")
"""Those that only a scene with layers or gravity has."""


def summarize(
    case: Case,
    trunk: TrunkMesh,
    model: Model,
    increments: Sequence[Increment],
    *,
    before: TrunkMeasures,
    after: TrunkMeasures,
    actual: TrunkMeasures | None = None,
    parameters: Mapping[str, Any] | None = None,
    seconds: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """The summary of a simulation in plain JSON types; what is not known or not finite is None."""
    last = increments[-1].relaxation
    known = {"relax": sum(increment.seconds for increment in increments), **(seconds or {})}
    return _plain(
        {
            "status": last.status.name,
            "tets": len(trunk.tets),
            "nodes": len(trunk.nodes),
            "free_nodes": int((~trunk.prescribed).sum()),
            "inverted_tets": last.inverted_tets,
            "device": model.device,
            "precision": model.precision,
            "parameters": {
                "case": case.name,
                **(dataclasses.asdict(model.tissue) if len(model.tissues) == 1 else {}),
                "gravity": model.gravity,
                **(parameters or {}),
            },
            "sag_mm": 0.0 if model.scan is None else np.linalg.norm(model.scan, axis=1).max(),
            "tissues": [dataclasses.asdict(tissue) for tissue in model.tissues],
            "terms": list(model.elements.terms),
            "increments": [_increment(increment) for increment in increments],
            "bsr_deg": {"before": before.bsr, "after": after.bsr, "actual": actual and actual.bsr},
            "cobb_deg": {
                when: [dataclasses.asdict(curve) for curve in measures.cobb]
                for when, measures in (("before", before), ("after", after))
            },
            "seconds": {
                stage: known.get(stage) for stage in (*STAGES, *SCENE_STAGES) if stage in STAGES or stage in known
            },
            "peak_memory_mb": peak_memory(),
            "versions": versions(),
        }
    )


def peak_memory() -> float | None:
    """Largest resident memory of this process or one of its children so far [MB]; None where not known."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    unit = 1.0 if sys.platform == "darwin" else 1024.0
    who = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return max(resource.getrusage(w).ru_maxrss for w in who) * unit / 1e6


def versions() -> dict[str, str | None]:
    """Versions of this program and of what its numbers depend on."""
    found: dict[str, str | None] = {"python": platform.python_version(), "platform": platform.platform()}
    for package in ("warp-trunk", "warp-lang", "numpy", "scipy", "tetgen", "trimesh", "rerun-sdk"):
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = None
    return found


def _increment(increment: Increment) -> dict[str, Any]:
    relaxation = increment.relaxation
    return {
        "load_factor": increment.load_factor,
        "status": relaxation.status.name,
        "energy": _energy(relaxation.energy),
        "steps": relaxation.steps,
        "linear_iterations": relaxation.linear_iterations,
        "estimated_error_mm": relaxation.estimated_error,
        "seconds": increment.seconds,
        "history": [_step(step) for step in relaxation.history],
    }


def _step(step: RelaxStep) -> dict[str, Any]:
    return {
        "energy": _energy(step.energy),
        "estimated_error_mm": step.estimated_error,
        "step_length": step.step_length,
        "linear_iterations": step.linear_iterations,
        "seconds": step.seconds,
    }


def _energy(energy: Energy) -> dict[str, float]:
    return {**dataclasses.asdict(energy), "total": energy.total}


def _plain(value: Any) -> Any:
    """The same in types of JSON, which has no NaN and no infinity: those become None."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(item) for item in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return value if value is None or isinstance(value, str) else str(value)
