"""What a peer is given and what it gives back, as two files. NumPy alone: a peer may have a Python of its own."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class Task:
    """A trunk at rest, where its bones go, and how well the rest of it has to be found."""

    nodes: np.ndarray
    """Positions at rest [mm], shape (nodes, 3)."""
    tets: np.ndarray
    """Corners, shape (tets, 4)."""
    held: np.ndarray
    """Which nodes are prescribed, shape (nodes,)."""
    image: np.ndarray
    """Displacement of the spline's image, where held nodes stay and others may start, shape (nodes, 3) [mm]."""
    truth: np.ndarray
    """Displacement at the equilibrium of the peer's law, shape (nodes, 3) [mm]."""
    youngs_modulus: float
    """[N/mm^2]"""
    poisson_ratio: float
    """At rest."""
    accuracy: float
    """Largest distance of a node from the truth at which a run may end [mm]."""

    def error(self, displacement: np.ndarray) -> float:
        """Largest distance of a node from the truth [mm]; infinite where a place is no number."""
        largest = float(np.linalg.norm(displacement - self.truth, axis=1).max())
        return largest if np.isfinite(largest) else float("inf")


@dataclass(frozen=True)
class Run:
    """One way of a peer, timed."""

    way: str
    """Solver, or options."""
    setup_seconds: float
    """What knows only the trunk at rest, not where its bones go [s]."""
    seconds: float
    """From there to the end [s]."""
    error_mm: float
    """Largest distance of a node from the truth of the peer's law [mm]."""
    work: dict[str, float]
    """What it consists of."""


@dataclass(frozen=True, eq=False)
class Answer:
    """What a peer found."""

    version: str
    """Of the package, and of its solver."""
    runs: list[Run]
    """Its ways."""
    converged: np.ndarray | None = None
    """Where it ends without being stopped, shape (nodes, 3) [mm]; None where that was not waited for."""


def write_task(path: Path, task: Task) -> None:
    """As npz without pickle."""
    _write(path, {field.name: np.asarray(getattr(task, field.name)) for field in fields(Task)})


def read_task(path: Path) -> Task:
    """What `write_task` wrote."""
    with np.load(path) as file:
        stored = {field.name: file[field.name] for field in fields(Task)}
    values: dict[str, Any] = {name: array if array.ndim else float(array) for name, array in stored.items()}
    return Task(**values)


def write_answer(path: Path, answer: Answer) -> None:
    """As npz without pickle; the runs are one JSON text."""
    arrays = {
        "version": np.array(answer.version),
        "runs": np.array(json.dumps([asdict(run) for run in answer.runs])),
    }
    if answer.converged is not None:
        arrays["converged"] = answer.converged
    _write(path, arrays)


def read_answer(path: Path) -> Answer:
    """What `write_answer` wrote."""
    with np.load(path) as file:
        runs = [Run(**run) for run in json.loads(str(file["runs"]))]
        converged = file["converged"] if "converged" in file.files else None
        return Answer(str(file["version"]), runs, converged)


def _write(path: Path, arrays: dict[str, Any]) -> None:
    """As npz; what is no array would need pickle and is refused when read."""
    with path.open("wb") as file:  # a file, because NumPy would add .npz to another name
        np.savez(file, **arrays)
