"""SciPy's L-BFGS-B on the same energy and gradient, as a yardstick from outside."""

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
    """Points of minimisations from the spline's image at full correction, each with twice the iterations.

    Energy and gradient come from the model of the setting. SciPy claims no distance from equilibrium.
    """
    from scipy.optimize import minimize

    start = time.perf_counter()
    model = make_model(problem, setting)
    state = State(model)
    state.set_displacement(problem.bone_path().at(1.0))
    state.evaluate()  # loads the kernel
    host = state.displacement.numpy().copy()
    first = host[model.free].astype(np.float64).ravel()
    setup, iterations = time.perf_counter() - start, FIRST_ITERATIONS

    def energy_and_gradient(x: np.ndarray) -> tuple[float, np.ndarray]:
        host[model.free] = x.reshape(-1, 3)
        state.set_from_rest(host)
        state.evaluate()
        return state.energy().total, state.gradient.numpy()[model.free].astype(np.float64).ravel()

    while True:
        start = time.perf_counter()
        options = {"maxcor": MEMORY, "maxiter": iterations, "maxfun": 10**9, "ftol": 0.0, "gtol": 0.0}
        end = minimize(energy_and_gradient, first, jac=True, method="L-BFGS-B", options=options)
        seconds = time.perf_counter() - start
        host[model.free] = end.x.reshape(-1, 3)
        places: Any = wp.array(host, dtype=model.vec3, device="cpu")
        stalled = end.nit < iterations
        yield {
            "increments": 1,
            "tolerance_mm": None,
            "max_steps": end.nit,
            "seconds": seconds,
            **vars(problem.errors(to_mesh_order(model, places))),
            "estimated_error_mm": None,
            "status": "STALLED" if stalled else "STEP_LIMIT",
            "steps": end.nit,
            "linear_iterations": 0,
            "evaluations": end.nfev,
            "setup_seconds": setup,
        }
        if stalled or 2.0 * seconds > limit:
            return
        iterations *= 2
