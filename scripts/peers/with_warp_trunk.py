"""This program, on all cores in float32; it ends by its own estimate of the distance to the equilibrium.

That is a bound and mostly far above the true error. The others are stopped in truth, so this one is also asked for
less: a way counts only where its true error is small enough.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib.metadata import version

import numpy as np
import warp as wp
from benchmarking.process import be_quiet

from warp_trunk import BonePath, RelaxOptions, SimulationOptions, Tissue, TrunkMesh, build_model, simulate
from warp_trunk.engine.newton import Relaxer

from .task import Task
from .timing import Peer, main, peer_of

WAYS = ((1, 1.0), (2, 1.0), (1, 10.0), (1, 100.0))
"""Parts of the motion, and the distance that is asked for, in parts of the accuracy."""


class _Made:
    """A model and what relaxes it."""

    def __init__(self, task: Task, increments: int, asked: float) -> None:
        self.relax = RelaxOptions(tolerance=asked * task.accuracy)
        self.options = SimulationOptions(increments=increments, relax=self.relax)
        tissue = Tissue(youngs_modulus=1e3 * task.youngs_modulus, poisson_ratio=task.poisson_ratio)
        self.model = build_model(as_trunk(task), tissue, energy="neo-hookean", device="cpu", skin_rigidity=0.0)
        self.relaxer = Relaxer(self.model, self.relax)
        self.path, self.displacement = BonePath(task.image), task.image

    def solve(self, enough: Callable[[np.ndarray], bool] | None) -> dict[str, float]:
        made = list(simulate(self.model, self.path, self.options, relaxer=self.relaxer))
        self.displacement = made[-1].displacement
        if enough:
            enough(self.displacement)
        return {
            "steps": sum(increment.relaxation.steps for increment in made),
            "linear_iterations": sum(increment.relaxation.linear_iterations for increment in made),
            "estimated_mm": made[-1].relaxation.estimated_error,
        }


def as_trunk(task: Task) -> TrunkMesh:
    """The mesh, with one bone and without what only measures need."""
    return TrunkMesh(
        nodes=task.nodes,
        tets=task.tets,
        skin_nodes=np.zeros(0, dtype=np.int32),
        skin_faces=np.zeros((0, 3), dtype=np.int32),
        bone=np.where(task.held, 0, -1).astype(np.int32),
        bone_names=("bone",),
        bone_faces=np.zeros((0, 3), dtype=np.int32),
    )


def make(task: Task) -> Peer:
    """The peer."""
    be_quiet()
    ways = {
        f"{count} increment{'s' * (count > 1)}, {asked * task.accuracy:g} mm": partial(_Made, task, count, asked)
        for count, asked in WAYS
    }
    named = f"warp_trunk {version('warp-trunk')}, Warp {wp.config.version}"
    return peer_of(task, named, ways, converges=False)


if __name__ == "__main__":
    main(make)
