"""scikit-fem: assembly in NumPy, factors by MKL PARDISO."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib.metadata import version

import numpy as np
from finite_elements.linear import Pardiso
from finite_elements.neo_hookean import NeoHookean
from finite_elements.newton import equilibrium
from finite_elements.solid import Solid

from .task import Task
from .timing import TIGHT, Peer, main, peer_of

KEEP = (0.3, 0.7, 0.0)
"""When factors serve another step (see `equilibrium`)."""


class _Made:
    """A solid whose order of elimination is known."""

    def __init__(self, task: Task, keep: float) -> None:
        self.task, self.keep = task, keep
        self.solid = Solid(task.nodes, task.tets, NeoHookean(task.youngs_modulus, task.poisson_ratio))
        self.factorise = Pardiso()
        free = np.flatnonzero(~task.held)
        unknown = np.concatenate([free + component * len(task.nodes) for component in range(3)])
        at_rest = self.solid.stiffness(np.zeros_like(task.nodes))[unknown][:, unknown]
        self.factorise.order(at_rest)
        self.displacement = task.image

    def solve(self, enough: Callable[[np.ndarray], bool] | None) -> dict[str, float]:
        found = equilibrium(
            self.solid,
            self.task.image,
            self.task.held,
            self.factorise,
            keep=self.keep,
            tolerance=TIGHT,
            enough=enough,
        )
        self.displacement = found.displacement
        return {
            "steps": found.steps,
            "factorisations": found.factorisations,
            "assembly_seconds": found.assembly_seconds,
            "solve_seconds": found.solve_seconds,
        }


def make(task: Task) -> Peer:
    """The peer."""
    ways = {f"keep {keep:g}": partial(_Made, task, keep) for keep in KEEP}
    named = f"scikit-fem {version('scikit-fem')}, MKL {version('mkl')}"
    return peer_of(task, named, ways, converges=True)


if __name__ == "__main__":
    main(make)
