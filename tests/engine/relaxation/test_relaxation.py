"""The relaxation as its users see it, and the papers' projected gradient: where they end and what they report."""

from typing import Any

import numpy as np
import pytest

from support.meshes import block, block_with_bone
from support.models import held_turned, increments, model_of, relax
from support.reference import Reference, volumes
from warp_trunk.engine.descent import ProjectedGradient, spectral_length
from warp_trunk.engine.newton import Relaxer
from warp_trunk.engine.relaxation import Relaxation, RelaxOptions, RelaxStatus, RelaxStep
from warp_trunk.engine.state import Products
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.errors import InputError


def moved_bones() -> tuple[TrunkMesh, np.ndarray]:
    """Of two bones inside a block one moves by 3 mm."""
    trunk = block_with_bone((5, 3, 3), holes=((1, 1, 1), (3, 1, 1)))
    return trunk, np.where((trunk.bone == 1)[:, None], [2.0, -2.0, 1.0], 0.0)


SCENES = {"turned face": (block(), held_turned(block(), 25.0)), "moved bone": moved_bones()}
EACH_SCENE = pytest.mark.parametrize("scene", SCENES)


def single(trunk: TrunkMesh, start: np.ndarray, gravity: float = 0.0, **options: Any) -> tuple[Relaxation, Any]:
    """Relaxes in float32."""
    return relax(model_of(trunk, gravity=gravity, precision="float32"), start, **options)


@EACH_SCENE
@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_energy_never_rises_and_every_step_is_seen_as_it_was(gravity: float, scene: str) -> None:
    """Energies by term of each step, against the reference's at the displacement that a watcher saw."""
    trunk, start = SCENES[scene]
    relaxer = Relaxer(model_of(trunk, gravity=gravity), RelaxOptions(max_steps=200))
    relaxer.state.set_displacement(start)
    seen: list[tuple[RelaxStep, np.ndarray]] = []
    ended = relaxer.relax(watch=lambda step, state: seen.append((step, state.host_displacement())))
    assert tuple(step for step, _ in seen) == ended.history
    assert sum(step.linear_iterations for step, _ in seen) <= ended.linear_iterations
    reference = Reference(trunk, gravity=gravity)
    for step, displacement in seen:
        terms = reference.energies(displacement)
        assert step.energy.terms == pytest.approx({term: terms[term] for term in step.energy.terms}, rel=1e-9)
    energies = np.array([reference.energy(start)] + [step.energy.total for step in ended.history])
    assert len(energies) > 3
    assert (np.diff(energies) <= 1e-12 * np.abs(energies).max()).all()
    assert ended.energy.total == energies[-1] < energies[0]
    seconds = [step.seconds for step, _ in seen]
    assert seconds[0] > 0.0
    assert sorted(seconds) == seconds


@pytest.mark.parametrize("threads", [1, 2])
def test_two_runs_agree_to_the_last_bit(threads: int) -> None:
    trunk, start = SCENES["moved bone"]
    model = model_of(trunk, threads=threads, gravity=9.81, precision="float32")
    one, two = (relax(model, start, max_steps=60) for _ in range(2))
    assert (one[1] == two[1]).all()
    assert one[0] == two[0]


@pytest.mark.parametrize("threads", [2, 3])
def test_threads_change_only_rounding(threads: int) -> None:
    trunk, start = SCENES["turned face"]
    one, many = (relax(model_of(trunk, threads=count), start, tolerance=1e-8) for count in (1, threads))
    np.testing.assert_allclose(many[1], one[1], atol=1e-7)
    assert many[0].energy.total == pytest.approx(one[0].energy.total, rel=1e-12)


def test_a_bound_on_steps_holds() -> None:
    ended, _ = single(*SCENES["turned face"], max_steps=2, tolerance=1e-6)
    assert ended.status is RelaxStatus.STEP_LIMIT
    assert ended.steps == len(ended.history) == 2


@EACH_SCENE
def test_float32_reports_that_it_cannot_reach_a_nanometre(scene: str) -> None:
    ended, found = single(*SCENES[scene], tolerance=1e-9, max_steps=2000)
    assert ended.status is RelaxStatus.STALLED
    rounding = np.finfo(np.float32).eps * np.abs(found).max()
    true = Reference(SCENES[scene][0]).error(found)
    assert 1e-9 < true <= rounding + 2.0 * ended.estimated_error


def test_small_motions_take_newton_few_steps() -> None:
    """Near rest the energy is quadratic and its assembled curvature exact, so a step leaves little."""
    trunk, start = SCENES["moved bone"]
    ended, _ = relax(model_of(trunk), 1e-4 * start, tolerance=1e-10)
    assert ended.status is RelaxStatus.CONVERGED
    assert ended.steps <= 16


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_start_that_is_not_finite_is_called_so(precision: str) -> None:
    trunk, start = SCENES["turned face"]
    start = np.vstack([start[:-1], [[np.nan, 0.0, 0.0]]])
    ended, _ = relax(model_of(trunk, precision=precision), start)
    assert (ended.status, ended.steps) == (RelaxStatus.NOT_FINITE, 0)


def test_the_tolerance_of_a_call_precedes_that_of_the_options_and_another_call_changes_little() -> None:
    trunk, start = SCENES["turned face"]
    relaxer = Relaxer(model_of(trunk, precision="float32"), RelaxOptions(tolerance=1e-4))
    relaxer.state.set_displacement(start)
    assert 1e-4 < relaxer.relax(1.0).estimated_error <= 1.0
    assert relaxer.relax().estimated_error <= 1e-4
    first = relaxer.state.host_displacement()
    assert relaxer.relax().status is RelaxStatus.CONVERGED
    assert np.linalg.norm(relaxer.state.host_displacement() - first, axis=1).max() < 2e-4


@pytest.mark.parametrize(
    ("name", "value"),
    [("tolerance", 0.0), ("tolerance", np.nan), ("tolerance", np.inf), ("max_steps", 0), ("method", "steepest")],
)
def test_refuses_options_out_of_range(name: str, value: Any) -> None:
    with pytest.raises(InputError, match=name):
        RelaxOptions(**{name: value})


TRUNK = block_with_bone((5, 3, 3), holes=((1, 1, 1), (3, 1, 1)))
MOVED = np.where((TRUNK.bone == 1)[:, None], [2.0, -2.0, 1.0], 0.0)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_ends_stopped_with_an_honest_distance_and_bones_in_place(precision: str, gravity: float) -> None:
    model = model_of(TRUNK, precision=precision, gravity=gravity)
    one, two = (increments(model, MOVED, 2, method="gradient", max_steps=5000) for _ in range(2))
    ended, found = one[-1].relaxation, one[-1].displacement
    assert [each.relaxation.status for each in one] == [RelaxStatus.STOPPED] * 2
    assert (found[TRUNK.prescribed] == MOVED[TRUNK.prescribed]).all()
    true = Reference(TRUNK, gravity=gravity).error(found, 1e-6)
    assert 0.5 * true <= ended.estimated_error + 1e-6 <= 10.0 * true + 1e-4
    assert (two[-1].displacement == found).all()
    energies = [step.energy.total for step in ended.history]
    for number in range(11, len(energies)):
        assert energies[number] <= max(energies[number - 10 : number]) + 1e-6 * energies[0]
    assert 0.0 < energies[-1] < energies[0]


def test_inverts_nothing_and_stops_at_its_bound() -> None:
    relaxer = Relaxer(model_of(TRUNK), RelaxOptions(method="gradient", max_steps=3))
    relaxer.state.set_displacement(MOVED + np.random.default_rng(10).normal(scale=2.5, size=MOVED.shape))
    before = volumes(TRUNK.nodes + relaxer.state.host_displacement(), TRUNK.tets) <= 0.0
    seen = []
    ended = ProjectedGradient(relaxer).relax(lambda step, _: seen.append(step))
    assert (ended.status, ended.history) == (RelaxStatus.STEP_LIMIT, tuple(seen))
    assert len(seen) == 3
    after = volumes(TRUNK.nodes + relaxer.state.host_displacement(), TRUNK.tets) <= 0.0
    assert before.any()
    assert not (after & ~before).any()


def test_a_spectral_length_is_the_newton_step_of_a_constant_curvature() -> None:
    """E = 3/2 x^2 from x = 1, whose gradient is 3, by a step of 0.1: the next one leads to the minimum."""
    products = Products(slope=2.1 * -3.0, previous_slope=-9.0, direction_squared=9.0)
    assert spectral_length(0.1, products) == pytest.approx(1.0 / 3.0)
