"""Cost of each part of a scene: the model holds only what the scene needs."""

import gc
import importlib.util
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import warp as wp

from warp_trunk import Case, measure
from warp_trunk.engine.build import build_model
from warp_trunk.engine.model import Model
from warp_trunk.engine.parallel import Parallel
from warp_trunk.engine.physics import Physics
from warp_trunk.engine.simulation import Increment, SimulationOptions, simulate
from warp_trunk.engine.state import State
from warp_trunk.measures import TrunkMeasures
from warp_trunk.recording import Recording

from .problem import Problem
from .record import Setting
from .tables import markdown, number

GRAVITY = 9.81
"""[m/s^2]"""
EVALUATIONS = 20
"""Evaluations of which the median time is taken."""
ROUNDS = 3
"""Every scene is run so often, in turns, so that a change of the machine meets them all; the least counts."""

Observer = Callable[[Increment], object]


@dataclass
class Scene:
    """A row of the table."""

    name: str
    """The difference from the default."""
    model: Model
    """Its model."""
    observer: Callable[[], AbstractContextManager[Observer]] | None = None
    """Opens the observer of the increments of one run."""
    evaluation_ms: float = np.inf
    """Fused energy and gradient [ms]."""
    seconds: float = np.inf
    """Whole simulation after set-up, observer included [s]."""
    linear_iterations: int = 0
    """Of the whole simulation."""


def scenes_table(problem: Problem, setting: Setting) -> str:
    """The table of a problem: every scene, with its times also as ratios to the default's."""
    scenes = make_scenes(problem, setting)
    path = problem.bone_path()
    for scene in scenes:  # compiles and loads
        next(iter(simulate(scene.model, path)))
    for _ in range(ROUNDS):
        for scene in scenes:
            gc.collect()
            scene.evaluation_ms = min(scene.evaluation_ms, evaluation_ms(scene.model, path.at(0.5)))
            _run(scene, problem)
    default = scenes[0]
    rows = [
        [
            scene.name,
            number(scene.evaluation_ms),
            f"{scene.evaluation_ms / default.evaluation_ms:.2f}",
            number(scene.seconds),
            f"{scene.seconds / default.seconds:.2f}",
            str(scene.linear_iterations),
            f"{scene.seconds / scene.linear_iterations / (default.seconds / default.linear_iterations):.2f}",
        ]
        for scene in scenes
    ]
    header = ["scene", "evaluation [ms]", "ratio", "simulation [s]", "ratio", "linear iterations"]
    return markdown([*header, "ratio per iteration"], rows)


def make_scenes(problem: Problem, setting: Setting) -> list[Scene]:
    """The default and everything that is measured against it."""

    papers, parallel = Physics(energy="itmsm", skin_rigidity=0.0), Parallel(setting.device, setting.threads)
    continuum = replace(papers, energy="neo-hookean")

    def model(physics: Physics = papers, precision: str = setting.precision, **tissue: float) -> Model:
        tissues = replace(problem.tissue, **tissue)
        return build_model(problem.trunk, tissues, physics, device=parallel, precision=precision)

    default = model()
    scenes = [
        Scene("default", default),
        Scene("no area term (epsilon 0)", model(epsilon=0.0)),
        Scene("no volume term (theta 0)", model(theta=0.0)),
        Scene("gravity", model(replace(papers, gravity=GRAVITY))),
        Scene("float64", model(precision="float64")),
        Scene("weights by volume", model(replace(papers, weights="volume"))),
        Scene("neo-hookean, nu 0.45", model(continuum, poisson_ratio=0.45)),
        Scene("neo-hookean, nu 0.49", model(continuum, poisson_ratio=0.49)),
        Scene("skin and measures after each increment", default, lambda: _observing(problem, False)),
    ]
    if importlib.util.find_spec("rerun") is not None:
        scenes.append(Scene("the same, recorded", default, lambda: _observing(problem, True)))
    return scenes


def evaluation_ms(model: Model, displacement: np.ndarray) -> float:
    """Median time of energy and gradient at a displacement (nodes, 3) [ms]."""
    state = State(model)
    state.set_displacement(displacement)
    state.evaluate()
    spent = []
    for _ in range(EVALUATIONS):
        wp.synchronize_device(model.device)
        start = time.perf_counter()
        state.evaluate()
        wp.synchronize_device(model.device)
        spent.append(time.perf_counter() - start)
    return 1e3 * float(np.median(spent))


def _run(scene: Scene, problem: Problem) -> None:
    seconds, linear_iterations = 0.0, 0
    with nullcontext() if scene.observer is None else scene.observer() as observe:
        for increment in simulate(scene.model, problem.bone_path(), SimulationOptions()):
            seconds += increment.seconds
            linear_iterations += increment.relaxation.linear_iterations
            if observe is not None:
                start = time.perf_counter()
                observe(increment)
                seconds += time.perf_counter() - start
    scene.seconds = min(scene.seconds, seconds)
    scene.linear_iterations = linear_iterations


@contextmanager
def _observing(problem: Problem, recorded: bool) -> Iterator[Observer]:
    """Draws the skin and measures it after each increment; also records it, where that is asked for."""
    before, landmarks = problem.skin(np.zeros_like(problem.trunk.nodes)), problem.landmarks_after

    def measured(increment: Increment) -> TrunkMeasures:
        return measure(problem.skin(increment.displacement), landmarks, before)

    if not recorded:
        yield measured
        return
    case = Case(problem.name, before, {}, problem.landmarks_before, landmarks, tissue=problem.tissue)
    about = case, problem.trunk, measure(before, problem.landmarks_before), None, problem.bone_path()
    with tempfile.TemporaryDirectory() as folder, Recording(Path(folder) / "a.rrd", *about) as recording:
        yield lambda increment: recording.increment(increment, measured(increment))
