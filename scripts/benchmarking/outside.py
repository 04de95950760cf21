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

    start = time.perf_counter()
    model = make_model(problem, setting)
    state = State(model)
    state.place(problem.bone_path().at(1.0))
    state.evaluate()  # loads the kernel
    host = state.displacement.numpy().copy()
    setup = time.perf_counter() - start

    class LimitReachedError(Exception):
        pass

    evaluations = iterations = 0
    found: list[dict[str, Any]] = []
    looking = 0.0
    following = FIRST_ITERATIONS
    began = time.perf_counter()

    def energy_and_gradient(x: np.ndarray) -> tuple[float, np.ndarray]:
        nonlocal evaluations
        evaluations += 1
        host[model.free] = x.reshape(-1, 3)
        state.displacement.assign(host)
        state.evaluate()
        gradient = state.gradient.numpy()[model.free].astype(np.float64)
        return state.energy().total, gradient.ravel()

    def look(x: np.ndarray, status: str) -> None:
        nonlocal looking
        now = time.perf_counter()
        host[model.free] = x.reshape(-1, 3)
        displacement = to_mesh_order(model, wp.array(host, dtype=model.vec3, device="cpu"))
        found.append(
            {
                "increments": 1,
                "tolerance_mm": None,
                "max_steps": iterations,
                "seconds": now - began - looking,
                **vars(problem.errors(displacement)),
                "estimated_error_mm": None,
                "status": status,
                "steps": iterations,
                "linear_iterations": 0,
                "evaluations": evaluations,
                "setup_seconds": setup,
            }
        )
        looking += time.perf_counter() - now

    def after_iteration(x: np.ndarray) -> None:
        nonlocal iterations, following
        iterations += 1
        if time.perf_counter() - began - looking > limit:
            look(x, "TIME_LIMIT")
            raise LimitReachedError
        if iterations >= following:
            following *= 2
            look(x, "STEP_LIMIT")

    free = host[model.free].astype(np.float64).ravel()
    options = {"maxcor": MEMORY, "maxiter": 10**9, "maxfun": 10**9, "ftol": 0.0, "gtol": 0.0}
    try:
        end = minimize(
            energy_and_gradient, free, jac=True, method="L-BFGS-B", callback=after_iteration, options=options
        )
        look(end.x, "STALLED")
    except LimitReachedError:
        pass
    yield from found
