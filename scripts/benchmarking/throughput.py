"""How many plans of one patient are simulated in a second."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from warp_trunk import Landmarks
from warp_trunk.bone_motion.bone_path import BonePath, spline_path
from warp_trunk.engine.model import Model
from warp_trunk.engine.newton import Relaxer
from warp_trunk.engine.relaxation import RelaxOptions, RelaxStatus
from warp_trunk.engine.simulation import Increment, SimulationOptions, simulate

from .problem import Problem
from .record import Setting
from .tables import markdown, number
from .timing import make_model

TRUTH_TOLERANCE = 1e-3
"""Tolerance of each plan, one after the other, for the errors [mm]."""
LEAST, MOST = 0.5, 1.0
"""Parts of the correction that plans have."""
SCATTER = 1.0
"""Deviation of each coordinate of a landmark from its place in the correction [mm]."""
REPEATS = 3
"""A batch is simulated so often, and the least time is taken."""


@dataclass(frozen=True)
class Batch:
    """So many plans, given at once."""

    plans: int
    """How many."""
    seconds: float
    """From the first being asked for to the last being known."""
    error_mm: float
    """Largest distance of any node of any of them from its equilibrium [mm]."""
    claimed_mm: float
    """The largest such distance that a relaxation claims [mm]."""
    converged: int
    """How many converged."""
    device_mb: float | None
    """Device memory for all at once, over what the trunk takes alone [MB]; None on the CPU."""


def measure_batches(
    problem: Problem, setting: Setting, batches: Sequence[int], options: SimulationOptions
) -> list[Batch]:
    """Simulates batches of drawn plans of the problem's trunk; kernels are compiled, and relaxers made, before."""
    model = make_model(problem, setting)
    paths = drawn_paths(problem, max(batches), setting.device)
    exact = SimulationOptions(increments=options.increments, relax=RelaxOptions(tolerance=TRUTH_TOLERANCE))
    truths = [end.displacement for end in _ends(model, paths, exact, Relaxer(model, exact.relax))]
    return [_batch(model, paths[:count], options, truths) for count in batches]


def _batch(
    model: Model,
    paths: list[BonePath],
    options: SimulationOptions,
    truths: Sequence[np.ndarray],
) -> Batch:
    relaxer = Relaxer(model, options.relax)
    before = _free_memory(model)
    ends = _ends(model, paths, options, relaxer)  # relaxers are made
    taken = None if before is None else 1e-6 * (before - (_free_memory(model) or 0))
    seconds = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        ends = _ends(model, paths, options, relaxer)
        seconds.append(time.perf_counter() - start)
    return Batch(
        plans=len(paths),
        seconds=min(seconds),
        error_mm=max(
            float(np.linalg.norm(end.displacement - truth, axis=1).max())
            for end, truth in zip(ends, truths, strict=False)
        ),
        claimed_mm=max(end.relaxation.estimated_error for end in ends),
        converged=sum(end.relaxation.status is RelaxStatus.CONVERGED for end in ends),
        device_mb=taken,
    )


def _ends(model: Model, paths: list[BonePath], options: SimulationOptions, relaxer: Relaxer) -> list[Increment]:
    return [list(simulate(model, path, options, relaxer=relaxer))[-1] for path in paths]


def drawn_paths(problem: Problem, count: int, device: str) -> list[BonePath]:
    """Plans like the problem's: parts of its correction, with landmarks scattered about it."""
    random = np.random.default_rng(1)
    before, whole = problem.landmarks_before, problem.landmarks_after.points - problem.landmarks_before.points
    found = []
    for _ in range(count):
        moved = random.uniform(LEAST, MOST) * whole + random.normal(scale=SCATTER, size=whole.shape)
        after = Landmarks(before.names, before.points + moved)
        found.append(spline_path(problem.trunk.nodes, before, after, device))
    return found


def _free_memory(model: Model) -> int | None:
    """Free memory of the model's CUDA device [bytes]."""
    if not model.parallel.is_cuda:
        return None
    wp.synchronize_device(model.device)
    return wp.get_device(model.device).free_memory


def batch_table(batches: Sequence[Batch]) -> str:
    """Every batch as Markdown."""
    header = ["plans given", "a second", "error [mm]", "claimed [mm]", "CONVERGED", "device memory [MB]"]
    rows = [
        [
            str(one.plans),
            number(one.plans / one.seconds),
            number(one.error_mm),
            number(one.claimed_mm),
            f"{one.converged} of {one.plans}",
            "" if one.device_mb is None else f"{one.device_mb:.0f}",
        ]
        for one in batches
    ]
    return markdown(header, rows)
