"""FElupe: its own assembly on all cores, factors by MKL PARDISO."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from importlib.metadata import version
from typing import Any

import numpy as np
from finite_elements.linear import Pardiso
from finite_elements.neo_hookean import NeoHookean

from .task import Task
from .timing import TIGHT, Peer, main

MOST_STEPS = 30


class _Law:
    """The same strain energy, as FElupe wants a material."""

    def __init__(self, law: NeoHookean) -> None:
        self.law, self.x = law, [np.eye(3), np.zeros(0)]

    def gradient(self, x: list[np.ndarray], **_: Any) -> list[Any]:
        return [self.law.stress(x[0]), None]

    def hessian(self, x: list[np.ndarray], **_: Any) -> list[np.ndarray]:
        return [self.law.tangent(x[0])]


class _Made:
    """A solid body whose order of elimination is known."""

    def __init__(self, task: Task, keep: bool) -> None:
        felupe: Any = import_module("felupe")
        self.task, self.keep = task, keep
        mesh = felupe.Mesh(task.nodes, task.tets.astype(np.int64), "tetra")
        self.field = felupe.FieldContainer([felupe.Field(felupe.RegionTetra(mesh), dim=3)])
        law = NeoHookean(task.youngs_modulus, task.poisson_ratio)
        self.body = felupe.SolidBody(_Law(law), self.field)
        self.free = (3 * np.flatnonzero(~task.held)[:, None] + np.arange(3)).ravel()
        self.factorise = Pardiso()
        self.factorise.order(self._stiffness())

    def _stiffness(self) -> Any:
        return self.body.assemble.matrix(self.field, parallel=True)[self.free][:, self.free]

    def solve(self, enough: Callable[[np.ndarray], bool] | None) -> dict[str, float]:
        """Newton's method; while `keep`, factors serve as long as each step is at most 0.3 of the one before."""
        places, u = self.task.nodes, self.field[0].values
        u[:] = self.task.image
        solve, last, factorisations, step = None, np.inf, 0, 0
        while step < MOST_STEPS:
            step += 1
            if solve is None:
                solve, factorisations = self.factorise(self._stiffness(), places), factorisations + 1
            forces = np.asarray(self.body.assemble.vector(self.field, parallel=True).todense()).ravel()
            moved = -solve(forces[self.free]).reshape(-1, 3)
            u[~self.task.held] += moved
            longest = float(np.linalg.norm(moved, axis=1).max())
            if enough(u) if enough else longest <= TIGHT:
                break
            if not self.keep or (step > 1 and longest > 0.3 * last):
                solve = None
            last = longest
        return {"steps": step, "factorisations": factorisations}


def make(task: Task) -> Peer:
    """The peer."""
    ways: dict[str, Callable[[], Any]] = {
        "factors kept": partial(_Made, task, True),
        "Newton": partial(_Made, task, False),
    }
    return Peer(
        f"FElupe {version('felupe')}, MKL {version('mkl')}",
        ways,
        _Made.solve,
        task.error,
        lambda made: made.field[0].values.copy(),
    )


if __name__ == "__main__":
    main(make)
