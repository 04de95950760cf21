"""A whole simulation with its times."""

import gc
import time
from dataclasses import dataclass

import numpy as np

from warp_trunk.bone_motion.prescribed_motion import PrescribedMotion
from warp_trunk.engine.build import build_model
from warp_trunk.engine.model import Model
from warp_trunk.engine.parallel import Parallel
from warp_trunk.engine.physics import Physics
from warp_trunk.engine.relaxation import Relaxation, RelaxOptions, RelaxStatus
from warp_trunk.engine.simulation import SimulationOptions, simulate

from .problem import Problem
from .record import Setting

REPEATS = 3
"""A short simulation is run so often, and the least time is taken: the machine only ever adds to it."""
SHORT = 10.0
"""Simulations longer than this are run once [s]."""


@dataclass(frozen=True)
class Timed:
    """A simulation that came to its end."""

    seconds: float
    """All increments."""
    setup_seconds: float
    """From the model to the first increment: preconditioner and recorded launches."""
    displacement: np.ndarray
    """At the end, shape (nodes, 3) [mm]."""
    relaxations: list[Relaxation]
    """How every increment ended."""

    @property
    def last(self) -> Relaxation:
        """How the last increment ended."""
        return self.relaxations[-1]

    @property
    def converged(self) -> bool:
        """Whether every increment came to its tolerance."""
        ended = (RelaxStatus.CONVERGED, RelaxStatus.NEAR)
        return all(relaxation.status in ended for relaxation in self.relaxations)


def make_model(problem: Problem, setting: Setting) -> Model:
    """The model of a problem as a setting wants it."""
    return build_model(
        problem.trunk,
        problem.tissue,
        Physics(energy=setting.energy, skin_rigidity=problem.skin_rigidity),
        device=Parallel(setting.device, setting.threads),
        precision=setting.precision,
    )


def run(model: Model, path: PrescribedMotion, relax: RelaxOptions) -> Timed:
    """One simulation."""
    gc.collect()  # what the last one holds on the device
    start = time.perf_counter()
    relaxations: list[Relaxation] = []
    seconds = setup = 0.0
    increment = None
    for increment in simulate(model, path, SimulationOptions(relax=relax)):
        if not relaxations:
            setup = time.perf_counter() - start - increment.seconds
        relaxations.append(increment.relaxation)
        seconds += increment.seconds
    assert increment is not None  # there is at least one
    return Timed(seconds, setup, increment.displacement, relaxations)


def run_least(model: Model, path: PrescribedMotion, relax: RelaxOptions, repeats: int = REPEATS) -> Timed:
    """The fastest of so many simulations, or the first one if it is not short."""
    timed = run(model, path, relax)
    for _ in range(repeats - 1):
        if timed.seconds > SHORT:
            break
        timed = min(timed, run(model, path, relax), key=lambda run: run.seconds)
    return timed


def warm_up(model: Model, path: PrescribedMotion, relax: RelaxOptions) -> None:
    """Loads every kernel a simulation uses, by its first increment."""
    next(iter(simulate(model, path, SimulationOptions(relax=relax))))
