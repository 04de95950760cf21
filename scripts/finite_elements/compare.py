"""warp_trunk and scikit-fem on one mesh: how far apart they end, and how long each takes to the same accuracy."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from benchmarking.problem import Problem

from warp_trunk import InputError, Model, RelaxOptions, RelaxStatus, SimulationOptions, build_model, simulate

from .linear import Factorise
from .neo_hookean import NeoHookean
from .newton import equilibrium
from .solid import Solid, weight

ACCURACY = 0.01
"""Largest distance of a node from the equilibrium that a timed run may leave [mm]."""
EXACT = 1e-8
"""The same for the solution that is compared and that errors are measured against."""
INCREMENTS = (1, 2, 5)
"""Of warp_trunk's loop; the fastest counts."""
KEEP = (0.0, 0.3, 0.7)
"""When scikit-fem's factors serve another step (see `equilibrium`); the fastest counts."""


@dataclass(frozen=True)
class Run:
    """One way from the trunk before surgery to the trunk after it, with what it took."""

    package: str
    """warp_trunk or scikit-fem."""
    way: str
    """Increments, or when factors are kept."""
    seconds: float
    """All of it: preconditioner or factors, assembly and solves [s]."""
    setup_seconds: float
    """The part of it that knows only the trunk at rest, not the plan: warp_trunk's preconditioner [s]."""
    error_mm: float
    """Largest distance of a node from the equilibrium [mm]."""
    work: dict[str, float]
    """What it consists of."""


@dataclass(frozen=True)
class LinearRun:
    """One linear solve with the stiffness and the forces of the first Newton step."""

    solver: str
    setup_seconds: float
    """Factors, or the levels of a preconditioner [s]."""
    solve_seconds: float
    """One right-hand side [s]."""
    error_mm: float
    """Largest difference of the step from that of the first solver [mm]."""


class Comparison:
    """One trunk, one plan, one material, for both."""

    def __init__(self, problem: Problem, gravity: float, factorise: Factorise) -> None:
        self.problem, self.gravity, self.factorise = problem, gravity, factorise
        self.path = problem.bone_path()
        trunk, tissue = problem.trunk, problem.tissue
        self.solid = Solid(  # in N and mm
            trunk.nodes,
            trunk.tets,
            NeoHookean(1e-3 * tissue.youngs_modulus, tissue.poisson_ratio),
            weight(trunk.nodes, trunk.tets, 1e-9 * tissue.density * gravity),
        )

    @cached_property
    def truth(self) -> np.ndarray:
        """scikit-fem's equilibrium from the spline's image, shape (nodes, 3) [mm]."""
        held = self.problem.trunk.prescribed
        start = self.path.displacement
        return equilibrium(self.solid, start, held, self.factorise, tolerance=EXACT, keep=0.3).displacement

    def distances(self, displacement: np.ndarray) -> np.ndarray:
        """Of every node from the truth [mm], shape (nodes,)."""
        return np.linalg.norm(displacement - self.truth, axis=1)

    def model(self, precision: str) -> Model:
        """The trunk for warp_trunk, on all cores."""
        trunk, tissue = self.problem.trunk, self.problem.tissue
        return build_model(
            trunk, tissue, energy="neo-hookean", gravity=self.gravity, device="cpu", precision=precision
        )

    def simulated(self, model: Model, tolerance: float, increments: int) -> tuple[np.ndarray, dict[str, float]]:
        """Where warp_trunk ends, shape (nodes, 3) [mm], and what that took.

        Raises:
            InputError: it does not converge.
        """
        options = SimulationOptions(increments=increments, relax=RelaxOptions(tolerance=tolerance))
        start = time.perf_counter()
        made = list(simulate(model, self.path, options))
        seconds = time.perf_counter() - start
        if made[-1].relaxation.status is not RelaxStatus.CONVERGED:
            raise InputError(f"warp_trunk in {increments} increments: {made[-1].relaxation.status.value}")
        return made[-1].displacement, {
            "seconds": seconds,
            "setup_seconds": seconds - sum(increment.seconds for increment in made),
            "steps": sum(increment.relaxation.steps for increment in made),
            "linear_iterations": sum(increment.relaxation.linear_iterations for increment in made),
        }

    def solved(self, keep: float) -> tuple[np.ndarray, dict[str, float]]:
        """scikit-fem's solution in one increment, ended in its favour: once its true error is small enough."""
        start = time.perf_counter()
        found = equilibrium(
            self.solid,
            self.path.displacement,
            self.problem.trunk.prescribed,
            self.factorise,
            keep=keep,
            enough=lambda displacement: bool(self.distances(displacement).max() <= ACCURACY),
        )
        return found.displacement, {
            "seconds": time.perf_counter() - start,
            "assembly_seconds": found.assembly_seconds,
            "solve_seconds": found.solve_seconds,
            "steps": found.steps,
            "factorisations": found.factorisations,
        }

    def timed(self, rounds: int) -> list[Run]:
        """Every way to ACCURACY: warp_trunk in float32 by its own estimate, scikit-fem in truth.

        All are timed in turn, and that a few times: the least time counts, for the machine only ever adds to it.
        """
        model = self.model("float32")
        ways: dict[tuple[str, str], Callable[[], tuple[np.ndarray, dict[str, float]]]] = {}
        for count in INCREMENTS:
            ways["warp_trunk", f"increments {count}"] = partial(self.simulated, model, ACCURACY, count)
        for keep in KEEP:
            ways["scikit-fem", f"keep {keep:g}"] = partial(self.solved, keep)
        best: dict[tuple[str, str], Run] = {}
        for _ in range(rounds):
            for (package, way), run in ways.items():
                displacement, work = run()
                seconds, setup = work.pop("seconds"), work.pop("setup_seconds", 0.0)
                error = float(self.distances(displacement).max())
                made = Run(package, way, seconds, setup, error, work)
                best[package, way] = min(made, best.get((package, way), made), key=lambda run: run.seconds)
        return list(best.values())

    def linear_runs(self, solvers: dict[str, Factorise]) -> Iterator[LinearRun]:
        """Each solver on the first Newton step."""
        start, free = self.path.displacement, np.flatnonzero(~self.problem.trunk.prescribed)
        unknown = np.concatenate([free + component * len(start) for component in range(3)])
        matrix = self.solid.stiffness(start)[unknown][:, unknown]
        forces = self.solid.forces(start)[free].T.ravel()
        first: np.ndarray | None = None
        for name, factorise in solvers.items():
            begin = time.perf_counter()
            solve = factorise(matrix, self.problem.trunk.nodes[free])
            made = time.perf_counter()
            step = solve(-forces)
            end = time.perf_counter()
            first = step if first is None else first
            yield LinearRun(name, made - begin, end - made, float(np.abs(step - first).max()))
