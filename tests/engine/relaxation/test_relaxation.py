"""The relaxation as its users see it: where it ends, what it reports, and what it never does."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest

from support.meshes import block, block_with_bone, rotate
from support.reference import Reference, volumes
from support.threads import split_launches
from warp_trunk.engine.build import build_model
from warp_trunk.engine.newton import Relaxer
from warp_trunk.engine.relaxation import Relaxation, RelaxOptions, RelaxStatus, RelaxStep
from warp_trunk.engine.state import State
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.errors import InputError

METHODS = ["newton", "conjugate", "gradient"]


@dataclass(frozen=True)
class Ending:
    """A relaxation and where it ended."""

    relaxation: Relaxation
    displacement: np.ndarray


def relaxed(trunk: TrunkMesh, start: np.ndarray, gravity: float = 0.0, threads: int = 2, **options: Any) -> Ending:
    """Relaxes from a start; options for the model and the relaxation by name."""
    mine = {name: options.pop(name) for name in ("method", "tolerance", "max_steps") if name in options}
    model = build_model(
        trunk,
        gravity=gravity,
        device=split_launches(threads),
        **{"energy": "itmsm", "skin_rigidity": 0.0, **options},
    )
    relaxer = Relaxer(model, RelaxOptions(**mine))
    relaxer.state.set_displacement(start)
    relaxation = relaxer.relax()
    return Ending(relaxation, relaxer.state.host_displacement())


def turned_face(degrees: float = 25.0) -> tuple[TrunkMesh, np.ndarray]:
    """The held face of a block turns; the rest of it has not followed yet."""
    trunk = block((3, 3, 3))
    start = np.zeros_like(trunk.nodes)
    start[trunk.prescribed] = rotate(trunk.nodes[trunk.prescribed], degrees) - trunk.nodes[trunk.prescribed]
    return trunk, start


def moved_bones() -> tuple[TrunkMesh, np.ndarray]:
    """Of two bones inside a block one moves by 3 mm."""
    trunk = block_with_bone((5, 3, 3), holes=((1, 1, 1), (3, 1, 1)))
    start = np.zeros_like(trunk.nodes)
    start[trunk.bone == 1] = [2.0, -2.0, 1.0]
    return trunk, start


SCENES = {"turned face": turned_face(), "moved bone": moved_bones()}


@cache
def equilibrium(scene: str, gravity: float) -> np.ndarray:
    """Where a scene ends, found without the engine to 1e-9 mm."""
    trunk, start = SCENES[scene]
    return Reference(trunk, gravity=gravity).equilibrium(start)


def true_error(ending: Ending, scene: str, gravity: float = 0.0) -> float:
    """Largest distance of a node from there [mm]."""
    return float(np.linalg.norm(ending.displacement - equilibrium(scene, gravity), axis=1).max())


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_prescribed_nodes_never_move_by_a_bit(method: str, scene: str, precision: str) -> None:
    trunk, start = SCENES[scene]
    start = start + np.random.default_rng(9).normal(scale=0.3, size=start.shape)
    start = start.astype(precision).astype(float)
    ending = relaxed(trunk, start, method=method, precision=precision, max_steps=30, tolerance=1e-3)
    assert ending.relaxation.steps > 0
    held = trunk.prescribed
    assert (ending.displacement[held] == start[held]).all()
    assert (ending.displacement[~held] != start[~held]).any(axis=1).all()


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("gravity", [0.0, 9.81])
@pytest.mark.parametrize("method", ["newton", "conjugate"])
def test_energy_never_rises(method: str, gravity: float, scene: str) -> None:
    trunk, start = SCENES[scene]
    reference = Reference(trunk, gravity=gravity)
    ending = relaxed(trunk, start, gravity, method=method, precision="float64", max_steps=200)
    energies = np.array([reference.energy(start)] + [step.energy.total for step in ending.relaxation.history])
    assert len(energies) > 3
    assert (np.diff(energies) <= 1e-12 * np.abs(energies).max()).all()
    assert ending.relaxation.energy.total == energies[-1] < energies[0]
    assert energies[-1] == pytest.approx(reference.energy(ending.displacement), rel=1e-10)


@pytest.mark.parametrize("method", METHODS)
def test_methods_end_at_the_same_equilibrium(method: str) -> None:
    trunk, start = turned_face(10.0)
    ending = relaxed(trunk, start, method=method, precision="float64", tolerance=1e-3, max_steps=3000)
    assert ending.relaxation.status is RelaxStatus.CONVERGED
    wanted = relaxed(trunk, start, precision="float64", tolerance=1e-8).displacement
    assert np.linalg.norm(ending.displacement - wanted, axis=1).max() < 2e-3


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("gravity", [0.0, 9.81])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("tolerance", [1.0, 0.1, 0.01])
def test_reported_error_is_honest(method: str, gravity: float, scene: str, tolerance: float) -> None:
    """The true distance, to a dense float64 solution of an energy written apart, is at most twice the reported."""
    trunk, start = SCENES[scene]
    ending = relaxed(trunk, start, gravity, method=method, tolerance=tolerance, max_steps=2000)
    if method == "gradient" and ending.relaxation.status is not RelaxStatus.CONVERGED:
        assert ending.relaxation.estimated_error < 10.0 * tolerance  # slow, and float32 hides its small steps
    else:
        assert ending.relaxation.status is RelaxStatus.CONVERGED
        assert ending.relaxation.estimated_error <= tolerance
    assert true_error(ending, scene, gravity) <= 2.0 * ending.relaxation.estimated_error


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("threads", [1, 2])
def test_two_runs_agree_to_the_last_bit(method: str, threads: int) -> None:
    trunk, start = SCENES["moved bone"]
    one, two = (relaxed(trunk, start, 9.81, method=method, threads=threads, max_steps=60) for _ in range(2))
    assert (one.displacement == two.displacement).all()
    assert one.relaxation.energy == two.relaxation.energy
    assert one.relaxation.history == two.relaxation.history


@pytest.mark.parametrize("threads", [2, 3])
def test_threads_change_only_rounding(threads: int) -> None:
    trunk, start = SCENES["turned face"]
    one = relaxed(trunk, start, threads=1, precision="float64", tolerance=1e-8)
    many = relaxed(trunk, start, threads=threads, precision="float64", tolerance=1e-8)
    np.testing.assert_allclose(many.displacement, one.displacement, atol=1e-7)
    assert many.relaxation.energy.total == pytest.approx(one.relaxation.energy.total, rel=1e-12)


@pytest.mark.parametrize("scene", SCENES)
def test_float32_ends_where_float64_does(scene: str) -> None:
    trunk, start = SCENES[scene]
    single = relaxed(trunk, start, 9.81, tolerance=1e-3)
    double = relaxed(trunk, start, 9.81, tolerance=1e-3, precision="float64")
    assert single.relaxation.status is double.relaxation.status is RelaxStatus.CONVERGED
    assert np.linalg.norm(single.displacement - double.displacement, axis=1).max() < 2e-3


@pytest.mark.parametrize("method", METHODS)
def test_a_bound_on_steps_holds(method: str) -> None:
    trunk, start = SCENES["turned face"]
    ending = relaxed(trunk, start, method=method, max_steps=2, tolerance=1e-6)
    assert ending.relaxation.status is RelaxStatus.STEP_LIMIT
    assert ending.relaxation.steps == len(ending.relaxation.history) == 2


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("method", METHODS)
def test_float32_says_that_it_cannot_reach_a_nanometre(method: str, scene: str) -> None:
    trunk, start = SCENES[scene]
    ending = relaxed(trunk, start, method=method, tolerance=1e-9, max_steps=2000)
    wanted = {RelaxStatus.STALLED, RelaxStatus.STEP_LIMIT} if method == "gradient" else {RelaxStatus.STALLED}
    assert ending.relaxation.status in wanted
    assert ending.relaxation.estimated_error > 1e-9
    rounding = np.finfo(np.float32).eps * np.abs(ending.displacement).max()
    assert 1e-9 < true_error(ending, scene) <= rounding + 2.0 * ending.relaxation.estimated_error


@pytest.mark.parametrize("method", METHODS)
def test_inverts_no_further_tetrahedron(method: str) -> None:
    """Whatever is inverted at the end was so at the start, and the count is right."""
    trunk, start = turned_face(60.0)
    start = start + np.random.default_rng(10).normal(scale=3.0, size=start.shape)
    before = volumes(trunk.nodes + start, trunk.tets) <= 0.0
    ending = relaxed(trunk, start, method=method, precision="float64", max_steps=300)
    after = volumes(trunk.nodes + ending.displacement, trunk.tets) <= 0.0
    assert before.any()
    assert not (after & ~before).any()
    assert ending.relaxation.inverted_tets == after.sum()


def test_an_equilibrium_stays() -> None:
    trunk = SCENES["turned face"][0]
    ending = relaxed(trunk, np.zeros_like(trunk.nodes), tolerance=1e-6)
    assert ending.relaxation.status is RelaxStatus.CONVERGED
    assert ending.relaxation.steps <= 2
    assert ending.relaxation.energy.total == 0.0
    assert (ending.displacement == 0.0).all()


def test_small_motions_take_newton_few_steps() -> None:
    """Near rest the energy is quadratic and its assembled curvature exact, so a step leaves little."""
    trunk, start = SCENES["moved bone"]
    ending = relaxed(trunk, 1e-4 * start, precision="float64", tolerance=1e-10)
    assert ending.relaxation.status is RelaxStatus.CONVERGED
    assert ending.relaxation.steps <= 16


def test_a_start_that_is_not_finite_is_called_so() -> None:
    trunk, start = turned_face()
    start[-1, 0] = np.nan
    for precision in ("float32", "float64"):
        ending = relaxed(trunk, start, precision=precision)
        assert ending.relaxation.status is RelaxStatus.NOT_FINITE
        assert ending.relaxation.steps == 0


def test_relaxing_again_changes_little() -> None:
    trunk, start = SCENES["moved bone"]
    relaxer = Relaxer(
        build_model(trunk, device=split_launches(), energy="itmsm", skin_rigidity=0.0),
        RelaxOptions(tolerance=1e-3),
    )
    relaxer.state.set_displacement(start)
    relaxer.relax()
    first = relaxer.state.host_displacement()
    again = relaxer.relax()
    assert again.status is RelaxStatus.CONVERGED
    assert np.linalg.norm(relaxer.state.host_displacement() - first, axis=1).max() < 1e-3


def test_the_tolerance_of_a_call_goes_before_that_of_the_options() -> None:
    trunk, start = SCENES["turned face"]
    relaxer = Relaxer(
        build_model(trunk, device=split_launches(), energy="itmsm", skin_rigidity=0.0),
        RelaxOptions(tolerance=1e-4),
    )
    relaxer.state.set_displacement(start)
    loose = relaxer.relax(1.0)
    assert 1e-4 < loose.estimated_error <= 1.0
    assert relaxer.relax().estimated_error <= 1e-4


@pytest.mark.parametrize(
    "options",
    [
        {"tolerance": 0.0},
        {"tolerance": -1.0},
        {"tolerance": np.nan},
        {"tolerance": np.inf},
        {"max_steps": 0},
        {"method": "steepest"},
    ],
)
def test_refuses_options_out_of_range(options: dict[str, Any]) -> None:
    (name,) = options
    with pytest.raises(InputError, match=name):
        RelaxOptions(**options)


def test_state_keeps_the_order_of_the_mesh() -> None:
    trunk, start = SCENES["moved bone"]
    start = start + np.random.default_rng(11).normal(size=start.shape)
    state = State(
        build_model(
            trunk, Tissue(), device=split_launches(), precision="float64", energy="itmsm", skin_rigidity=0.0
        )
    )
    state.set_displacement(start)
    assert (state.host_displacement() == start).all()


def test_every_step_is_seen_as_it_was() -> None:
    """Energies by term of each step, against the reference's at the displacement the watcher saw."""
    trunk, start = SCENES["moved bone"]
    model = build_model(
        trunk, gravity=9.81, device=split_launches(), precision="float64", energy="itmsm", skin_rigidity=0.0
    )
    relaxer = Relaxer(model, RelaxOptions(tolerance=1e-6))
    relaxer.state.set_displacement(start)
    seen: list[tuple[RelaxStep, np.ndarray]] = []
    relaxation = relaxer.relax(watch=lambda step, state: seen.append((step, state.host_displacement())))
    assert tuple(step for step, _ in seen) == relaxation.history
    assert len(seen) == relaxation.steps > 2
    assert sum(step.linear_iterations for step, _ in seen) <= relaxation.linear_iterations
    assert relaxation.history[-1].energy == relaxation.energy
    reference = Reference(trunk, gravity=9.81)
    for step, displacement in seen:
        assert step.energy.terms == pytest.approx(reference.energies(displacement), rel=1e-9)
    seconds = [step.seconds for step, _ in seen]
    assert seconds[0] > 0.0
    assert sorted(seconds) == seconds
