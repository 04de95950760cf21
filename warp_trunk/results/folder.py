"""The result folder: what a simulation leaves behind for viewers, for ParaView and for other programs."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import platform
import shutil
import sys
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from ..measures import TrunkMeasures, measure
from ..surface import Surface, write_surface
from ..trunk_mesh import TrunkMesh, write_trunk

if TYPE_CHECKING:
    from ..case import Case
    from ..model import Model
    from ..simulation import Increment

RECORDING = "recording.rrd"
SKIN_AFTER = "skin_after.ply"
TRUNK = "trunk.vtu"
SUMMARY = "summary.json"
STAGES = ("load", "surface", "mesh", "compile", "relax", "record", "total")
"""The parts of a run whose seconds a summary gives."""
LEAST_SPACE = 200e6
"""A result folder needs this much free space [bytes]; the largest results seen take a third of it."""


def prepare_folder(folder: str | Path) -> Path:
    """Create a result folder and make sure, before any long work, that a result can be written to it.

    Raises:
        InputError: it cannot be created or written to, or too little space is free.
    """
    folder = Path(folder)
    probe = folder / ".writable"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"x")
        probe.unlink()
    except OSError as error:
        raise InputError(
            f"{folder}: a result cannot be written here ({error.strerror}); give --out a folder of your own"
        ) from error
    free = shutil.disk_usage(folder).free
    if free < LEAST_SPACE:
        raise InputError(
            f"{folder}: {free / 1e6:.0f} MB are free on this disk; a result needs {LEAST_SPACE / 1e6:.0f} MB"
        )
    return folder


def partial(path: Path) -> Path:
    """The name of a file while it is being written; it keeps its ending, so that viewers open it anyway."""
    return path.with_name(f"{path.stem}.partial{path.suffix}")


def skin_after(case: Case, trunk: TrunkMesh, displacement: np.ndarray) -> Surface:
    """The skin of a case, same vertices and faces, carried by the nodes' displacement (nodes, 3) [mm]."""
    return Surface(case.skin.vertices + displacement[trunk.skin_nodes], case.skin.faces)


def write_result(
    folder: str | Path,
    case: Case,
    trunk: TrunkMesh,
    model: Model,
    increments: Sequence[Increment],
    *,
    parameters: Mapping[str, Any] | None = None,
    seconds: Mapping[str, float] | None = None,
    recording: Path | None = None,
) -> dict[str, Any]:
    """Write the result of a simulation: skin_after.ply, trunk.vtu, summary.json and the recording.

    Every file is written under another name and moved when it is complete, summary.json last; a folder that
    has one is whole. A recording of an earlier simulation in the same folder is removed.

    Args:
        folder: where to; made if it does not exist.
        case: the case that was simulated.
        trunk: its mesh.
        model: its model.
        increments: all that `simulate` yielded.
        parameters: options of the run for the summary, beside those the model knows.
        seconds: times by stage, see `STAGES`; the time of relaxation is known from the increments.
        recording: a finished recording, which is moved into the folder.

    Returns:
        The summary as written.

    Raises:
        InputError: the folder cannot be written to, or there is no increment.
    """
    if not increments:
        raise InputError("write_result: 'increments' is empty; give all that simulate() yielded")
    folder = prepare_folder(folder)
    last = increments[-1]
    skin = skin_after(case, trunk, last.displacement)
    write_surface(partial(folder / SKIN_AFTER), skin)
    write_trunk(partial(folder / TRUNK), trunk, last.displacement)
    summary = summarize(
        case,
        trunk,
        model,
        increments,
        before=measure(case.skin, case.landmarks_before),
        after=measure(skin, case.landmarks_after, case.skin),
        parameters=parameters,
        seconds=seconds,
    )
    text = json.dumps(summary, indent=2, allow_nan=False)
    partial(folder / SUMMARY).write_text(text + "\n", encoding="utf-8")
    if recording is None:
        (folder / RECORDING).unlink(missing_ok=True)
    else:
        os.replace(recording, folder / RECORDING)
    for name in (SKIN_AFTER, TRUNK, SUMMARY):
        os.replace(partial(folder / name), folder / name)
    return summary


def read_summary(folder: str | Path) -> dict[str, Any]:
    """The summary of a result folder.

    Raises:
        InputError: there is none, or it is not JSON.
    """
    path = Path(folder) / SUMMARY
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); give a folder that `simulate` wrote"
        ) from error
    except ValueError as error:
        raise InputError(f"{path}: is not JSON ({error}); simulate the case again") from error


def summarize(
    case: Case,
    trunk: TrunkMesh,
    model: Model,
    increments: Sequence[Increment],
    *,
    before: TrunkMeasures,
    after: TrunkMeasures,
    parameters: Mapping[str, Any] | None = None,
    seconds: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """The summary of a simulation in plain JSON types; what is not known or not finite is None."""
    last = increments[-1].relaxation
    actual = None
    if case.skin_after is not None and not case.skin_after_is_placeholder:
        actual = measure(case.skin_after, case.landmarks_after).bsr
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
                **dataclasses.asdict(model.tissue),
                "gravity": model.gravity,
                **(parameters or {}),
            },
            "increments": [_increment(increment) for increment in increments],
            "bsr_deg": {"before": before.bsr, "after": after.bsr, "actual": actual},
            "cobb_deg": {
                when: [dataclasses.asdict(curve) for curve in measures.cobb]
                for when, measures in (("before", before), ("after", after))
            },
            "seconds": {stage: known.get(stage) for stage in STAGES},
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
        "energy": {**dataclasses.asdict(relaxation.energy), "total": relaxation.energy.total},
        "steps": relaxation.steps,
        "linear_iterations": relaxation.linear_iterations,
        "estimated_error_mm": relaxation.estimated_error,
        "seconds": increment.seconds,
    }


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
