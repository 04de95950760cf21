"""warp_trunk and scikit-fem on one mesh: how far apart they end, and how linear solvers do on it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from benchmarking.problem import Problem

from warp_trunk import InputError, RelaxOptions, RelaxStatus, SimulationOptions, build_model, simulate

from .linear import Factorise
from .neo_hookean import NeoHookean
from .newton import equilibrium
from .solid import Solid, weight

EXACT = 1e-8
"""Largest distance of a node from the equilibrium in the solution that is compared [mm]."""


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

    def simulated(self, precision: str, tolerance: float) -> np.ndarray:
        """Where warp_trunk ends, on all cores, shape (nodes, 3) [mm].

        Raises:
            InputError: it does not converge.
        """
        trunk, tissue = self.problem.trunk, self.problem.tissue
        model = build_model(
            trunk,
            tissue,
            energy="neo-hookean",
            gravity=self.gravity,
            device="cpu",
            precision=precision,
            skin_rigidity=0.0,
        )
        *_, last = simulate(model, self.path, SimulationOptions(relax=RelaxOptions(tolerance=tolerance)))
        if last.relaxation.status is not RelaxStatus.CONVERGED:
            raise InputError(f"warp_trunk in {precision}: {last.relaxation.status.value}")
        return last.displacement

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
