"""SciPy's L-BFGS-B on the same energy and gradient, as a yardstick from outside."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import warp as wp

from warp_trunk.engine.state import State, to_mesh_order

from .problem import Problem
from .record import Setting
from .timing import make_model

OUTSIDE = "scipy-lbfgsb"
"""The name of this method."""
MEMORY = 10
"""Pairs that L-BFGS-B keeps."""
FIRST_ITERATIONS = 10
"""Iterations at the first point of the curve; each next has twice as many."""


def available() -> bool:
    """Whether SciPy is installed."""
    return importlib.util.find_spec("scipy") is not None


def outside_curve(problem: Problem, setting: Setting, limit: float) -> Iterator[dict[str, Any]]:
    """Points of one minimisation from the spline's image at full correction: all its time in one increment.

    Energy and gradient come from the model of the setting. Looking at the errors takes no part in the time.
    It knows no distance from equilibrium, so it claims none.
    """
    from scipy.optimize import minimize

    watched = _Minimisation(problem, setting, limit)
    try:
        end = minimize(
            watched.energy_and_gradient,
            watched.host[watched.model.free].astype(np.float64).ravel(),
            jac=True,
            method="L-BFGS-B",
            callback=watched.after_iteration,
            options={"maxcor": MEMORY, "maxiter": 10**9, "maxfun": 10**9, "ftol": 0.0, "gtol": 0.0},
        )
        watched.look(end.x, "STALLED")
    except _LimitReachedError:
        pass
    yield from watched.found


class _LimitReachedError(Exception):
    pass


class _Minimisation:
    """The function that SciPy minimises, recorded after 10, 20, 40, ... iterations."""

    def __init__(self, problem: Problem, setting: Setting, limit: float) -> None:
        start = time.perf_counter()
        self.problem, self.limit = problem, limit
        self.model = make_model(problem, setting)
        self.state = State(self.model)
        self.state.set_displacement(problem.bone_path().at(1.0))
        self.state.evaluate()  # loads the kernel
        self.host = self.state.displacement.numpy().copy()
        self.evaluations = self.iterations = 0
        self.following = FIRST_ITERATIONS
        self.found: list[dict[str, Any]] = []
        self.looking = 0.0
        self.began = time.perf_counter()
        self.setup = self.began - start

    def energy_and_gradient(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        self.evaluations += 1
        self.host[self.model.free] = x.reshape(-1, 3)
        self.state.displacement.assign(self.host)
        self.state.evaluate()
        gradient = self.state.gradient.numpy()[self.model.free].astype(np.float64)
        return self.state.energy().total, gradient.ravel()

    def look(self, x: np.ndarray, status: str) -> None:
        """Adds a point of the curve."""
        now = time.perf_counter()
        self.host[self.model.free] = x.reshape(-1, 3)
        places: Any = wp.array(self.host, dtype=self.model.vec3, device="cpu")
        displacement = to_mesh_order(self.model, places)
        self.found.append(
            {
                "increments": 1,
                "tolerance_mm": None,
                "max_steps": self.iterations,
                "seconds": now - self.began - self.looking,
                **vars(self.problem.errors(displacement)),
                "estimated_error_mm": None,
                "status": status,
                "steps": self.iterations,
                "linear_iterations": 0,
                "evaluations": self.evaluations,
                "setup_seconds": self.setup,
            }
        )
        self.looking += time.perf_counter() - now

    def after_iteration(self, x: np.ndarray) -> None:
        self.iterations += 1
        if time.perf_counter() - self.began - self.looking > self.limit:
            self.look(x, "TIME_LIMIT")
            raise _LimitReachedError
        if self.iterations >= self.following:
            self.following *= 2
            self.look(x, "STEP_LIMIT")
