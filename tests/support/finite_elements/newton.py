"""The equilibrium of a solid whose bones are held, by Newton's method with a line search on the energy."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .linear import Factorise, Solve
from .solid import Solid

MOST_STEPS = 100
"""Newton steps after which a solve counts as failed."""
SHORTENED = tuple(0.5**k for k in range(12))
"""Parts of a direction that the line search tries."""


class NotConvergedError(Exception):
    """The equilibrium was not found; the text says why."""


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A solution and what it cost."""

    displacement: np.ndarray
    """Of every node [mm], shape (nodes, 3)."""
    steps: int
    """Newton steps."""
    factorisations: int
    """Stiffness matrices assembled and factorised."""
    left: float
    """How far the equilibrium is estimated to be yet [mm]."""
    assembly_seconds: float
    """Energies, forces and stiffness [s]."""
    solve_seconds: float
    """Factors and solves [s]."""


def equilibrium(
    solid: Solid,
    start: np.ndarray,
    held: np.ndarray,
    factorise: Factorise,
    *,
    tolerance: float = 1e-8,
    keep: float = 0.0,
    enough: Callable[[np.ndarray], bool] | None = None,
) -> Equilibrium:
    """Relaxes the free nodes from `start` (nodes, 3) [mm]; the held ones (mask) stay where it has them.

    Args:
        solid: what is relaxed.
        start: displacement of every node, with the held ones at their place.
        held: which nodes are prescribed, shape (nodes,).
        factorise: how to solve with the stiffness.
        tolerance: estimated distance to the equilibrium at which to end [mm].
        keep: factors serve a further step as long as each is at most this part of the one before; with 0
            every step has its own, which is Newton's method.
        enough: ends it at the first displacement (nodes, 3) for which it holds, whatever the tolerance.

    Raises:
        NotConvergedError: no step lowers the energy, or too many steps.
    """
    descent = _Descent(solid, start, held, factorise)
    solve: Solve | None = None
    last = np.inf
    for step in range(1, MOST_STEPS + 1):
        solve = solve or descent.curvature(positive=False)
        direction, length, trial = descent.direction(solve)
        if length == 0.0:
            solve = descent.curvature(positive=True)
            direction, length, trial = descent.direction(solve)
        longest = float(np.linalg.norm(direction, axis=1).max())
        if length == 0.0:
            raise NotConvergedError(f"no step lowers the energy in step {step}, of {longest:.3g} mm")
        descent.move(length * direction, trial)
        shrink = longest / last if length == 1.0 and step > 1 else 1.0
        last = longest
        left = longest * shrink / (1.0 - shrink) if shrink < 1.0 else longest
        if enough(descent.displacement) if enough else left <= tolerance:
            return Equilibrium(
                descent.displacement,
                step,
                descent.factorisations,
                left,
                descent.clock.assembly_seconds,
                descent.clock.solve_seconds,
            )
        if keep == 0.0 or (step > 1 and shrink > keep):
            solve = None
    raise NotConvergedError(f"{MOST_STEPS} steps, the last of {last:.3g} mm")


class _Descent:
    """Where the solid is, and which way lowers its energy."""

    def __init__(self, solid: Solid, start: np.ndarray, held: np.ndarray, factorise: Factorise) -> None:
        self.clock = _Clock()
        self.displacement, self._energy = start.copy(), solid.energy(start)
        self.factorisations = 0
        self._solid, self._factorise = solid, factorise
        self._free = np.flatnonzero(~held)
        self._numbers = np.concatenate([self._free + component * len(start) for component in range(3)])

    def curvature(self, positive: bool) -> Solve | None:
        """The factors of the stiffness here, or of its positive part; nothing where there are none."""
        self.factorisations += 1
        matrix = self._solid.stiffness(self.displacement, positive)[self._numbers][:, self._numbers]
        self.clock.assembled()
        try:
            return self._factorise(matrix)
        except ArithmeticError:
            return None
        finally:
            self.clock.solved()

    def direction(self, solve: Solve | None) -> tuple[np.ndarray, float, float]:
        """A direction, how much of it lowers the energy (0: nothing), and the energy there."""
        direction = np.zeros_like(self.displacement)
        if solve is None:
            return direction, 0.0, self._energy
        forces = self._solid.forces(self.displacement)[self._free]
        self.clock.assembled()
        direction[self._free] = -solve(forces.T.ravel()).reshape(3, -1).T
        self.clock.solved()
        if (direction[self._free] * forces).sum() <= 0.0:
            for length in SHORTENED:
                trial = self._solid.energy(self.displacement + length * direction)
                if trial <= self._energy + self._solid.rounding:
                    return direction, length, trial
        return direction, 0.0, self._energy

    def move(self, step: np.ndarray, energy: float) -> None:
        """Goes a step to where the energy is as given."""
        self.displacement, self._energy = self.displacement + step, energy
        self.clock.assembled()


class _Clock:
    """Shares the time that has passed between assembly and solve."""

    def __init__(self) -> None:
        self.assembly_seconds = self.solve_seconds = 0.0
        self._at = time.perf_counter()

    def assembled(self) -> None:
        self.assembly_seconds += self._lap()

    def solved(self) -> None:
        self.solve_seconds += self._lap()

    def _lap(self) -> float:
        before, self._at = self._at, time.perf_counter()
        return self._at - before
