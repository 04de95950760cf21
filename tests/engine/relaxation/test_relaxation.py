"""The relaxation as its users see it: where it ends, what it claims there, and along the projected gradient."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from support.asserting import refuses
from support.continuum import Continuum
from support.meshes import block, block_with_bone, column, single_tet
from support.models import evaluated, held_turned, increments, model_of, relax
from support.reference import Reference, volumes
from warp_trunk.engine.descent import ProjectedGradient, spectral_length
from warp_trunk.engine.newton import Relaxer
from warp_trunk.engine.relaxation import RelaxOptions, RelaxStatus, RelaxStep
from warp_trunk.engine.sag_free import sag_free
from warp_trunk.engine.state import Products
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.engine.work import Work
from warp_trunk.errors import InputError


def moved_bones() -> tuple[TrunkMesh, np.ndarray]:
    """Of two bones inside a block one moves by 3 mm."""
    trunk = block_with_bone((5, 3, 3), holes=((1, 1, 1), (3, 1, 1)))
    return trunk, np.where((trunk.bone == 1)[:, None], [2.0, -2.0, 1.0], 0.0)


SCENES = {"turned face": (block(), held_turned(block(), 25.0)), "moved bone": moved_bones()}
EACH_SCENE = pytest.mark.parametrize("scene", SCENES)


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


@pytest.mark.parametrize("threads", [1, 3])
def test_two_runs_agree_to_the_last_bit_and_threads_change_only_rounding(threads: int) -> None:
    trunk, start = SCENES["moved bone"]
    model = model_of(trunk, threads=threads, gravity=9.81)
    first, two = (relax(model, start, max_steps=60, tolerance=1e-8) for _ in range(2))
    assert (first[1] == two[1]).all()
    assert first[0] == two[0]
    alone = relax(model_of(trunk, gravity=9.81), start, max_steps=60, tolerance=1e-8)
    np.testing.assert_allclose(first[1], alone[1], atol=1e-7)
    assert first[0].energy.total == pytest.approx(alone[0].energy.total, rel=1e-12)


def test_float32_reports_that_it_cannot_reach_a_nanometre() -> None:
    trunk, start = SCENES["moved bone"]
    ended, displacement = relax(model_of(trunk, precision="float32"), start, tolerance=1e-9, max_steps=2000)
    assert ended.status is RelaxStatus.STALLED
    rounding = np.finfo(np.float32).eps * np.abs(displacement).max()
    true = Reference(trunk).error(displacement)
    assert 1e-9 < true <= rounding + 2.0 * ended.estimated_error


@pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_from_its_equilibrium_a_relaxation_claims_without_a_search(energy: str, precision: str) -> None:
    """Turned as a whole, its energy is next to nothing, whose changes are no larger than rounding."""
    trunk, start = SCENES["turned face"]
    relaxer = Relaxer(model_of(trunk, energy=energy, precision=precision))
    relaxer.state.set_displacement(start)
    relaxer.relax(1e-5 if precision == "float32" else 1e-9)
    again = relaxer.relax()
    assert (again.status, again.steps, again.evaluations) == (RelaxStatus.CONVERGED, 0, 1)


def test_a_start_that_is_not_finite_is_called_so() -> None:
    trunk, start = SCENES["turned face"]
    ended, _ = relax(model_of(trunk, precision="float32"), np.vstack([start[:-1], [[np.nan, 0.0, 0.0]]]))
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


def test_refuses_options_and_tolerances_out_of_range() -> None:
    """With NaN it never ended."""
    for name, values in {
        "tolerance": (0.0, np.nan, np.inf, "0.1"),
        "max_steps": (0, 1.5),
        "method": ("ascent",),
    }.items():
        for value in values:
            with pytest.raises(InputError, match=name):
                RelaxOptions(**{name: value})
    model = model_of(block((2, 2, 2)), gravity=9.81)
    for tolerance in (np.nan, 0.0, -1.0):
        for use in (Relaxer(model).relax, partial(sag_free, model)):
            with refuses("positive", begins="tolerance"):
                use(tolerance)


@pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])
def test_float32_stalls_where_no_force_is_left_but_rounding_exceeds_the_tolerance(energy: str) -> None:
    """A trunk that is shifted as a whole is at its equilibrium, to the last bit; the estimate divided by zero."""
    trunk = block_with_bone((3, 3, 3), holes=((1, 1, 1),))
    shift = np.full_like(trunk.nodes, [100.0, 0.0, 0.0])
    model = model_of(trunk, energy=energy, precision="float32")
    ended, _ = relax(model, shift, tolerance=1e-4)
    assert (ended.status, ended.estimated_error) == (RelaxStatus.STALLED, np.inf)
    last = increments(model, shift, tolerance=1e-4)[-1]
    assert (last.relaxation.status, last.relaxer.model.precision) == (RelaxStatus.CONVERGED, "float64")
    np.testing.assert_allclose(last.displacement, shift, atol=1e-4)


TRUNK = block_with_bone((5, 3, 3), holes=((1, 1, 1), (3, 1, 1)))
MOVED = np.where((TRUNK.bone == 1)[:, None], [2.0, -2.0, 1.0], 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(("precision", "gravity"), [("float32", 0.0), ("float32", 9.81), ("float64", 9.81)])
def test_ends_stopped_with_an_honest_distance_and_bones_in_place(precision: str, gravity: float) -> None:
    model = model_of(TRUNK, precision=precision, gravity=gravity)
    first, two = (increments(model, MOVED, 2, method="gradient", max_steps=5000) for _ in range(2))
    ended, displacement = first[-1].relaxation, first[-1].displacement
    assert [each.relaxation.status for each in first] == [RelaxStatus.STOPPED] * 2
    assert (displacement[TRUNK.prescribed] == MOVED[TRUNK.prescribed]).all()
    true = Reference(TRUNK, gravity=gravity).error(displacement, 1e-6)
    assert 0.5 * true <= ended.estimated_error + 1e-6 <= 10.0 * true + 1e-4
    assert (two[-1].displacement == displacement).all()
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
    assert ended.estimated_error == seen[-1].estimated_error == np.inf  # STEP_LIMIT claims nothing
    after = volumes(TRUNK.nodes + relaxer.state.host_displacement(), TRUNK.tets) <= 0.0
    assert before.any()
    assert not (after & ~before).any()


def test_a_spectral_length_is_the_newton_step_of_a_constant_curvature() -> None:
    """E = 3/2 x^2 from x = 1, whose gradient is 3, by a step of 0.1: the next one leads to the minimum."""
    products = Products(slope=2.1 * -3.0, previous_slope=-9.0, direction_squared=9.0)
    assert spectral_length(0.1, products) == pytest.approx(1.0 / 3.0)


def test_a_saddle_is_left_although_no_force_points_away_from_it() -> None:
    """A corner held by three edges lies in the plane of their ends: there it is pressed, but not out of it."""
    trunk, edges = single_tet(), Tissue(epsilon=0.0, theta=0.0)
    start = np.zeros_like(trunk.nodes)
    start[3] = [2.0, 2.0, -10.0]
    reference = Reference(trunk, edges)
    assert reference.gradient(start)[3, 2] == 0.0
    model = model_of(trunk, edges, precision="float32")
    ended, displacement = relax(model, start, tolerance=0.01, max_steps=300)
    assert ended.status is RelaxStatus.CONVERGED
    assert abs(trunk.nodes[3, 2] + displacement[3, 2]) > 5.0
    assert np.linalg.eigvalsh(reference.hessian(displacement))[0] > 0.0
    assert reference.error(displacement) <= 2.0 * ended.estimated_error


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_direction_of_negative_curvature_is_followed_downwards(side: float) -> None:
    """Beside a saddle the gradient says which of its two ways that is."""
    trunk, start = single_tet(), np.zeros((4, 3))
    start[3] = [2.0, 2.0, -9.5]
    work = Work(evaluated(model_of(trunk, Tissue(epsilon=0.0, theta=0.0)), start))
    down = np.array([[0.0, 0.0, side]])
    work.descend(down, 0.1, on=False)
    assert np.vdot(work.state.gradient.numpy()[0], work.direction.numpy()[0]) < 0.0
    assert np.linalg.norm(work.direction.numpy()[0]) == pytest.approx(0.1)
    work.assemble(true=True)
    assert work.curvature(down) < 0.0
    for _ in range(2):
        work.direction.assign(side * work.direction.numpy())
        work.turn_downhill()
        assert work.products().slope < 0.0


@pytest.mark.parametrize("theta", [0.0, 1000.0])
def test_rounding_is_part_of_the_distance(theta: float) -> None:
    """In float32 no tolerance is claimed below what rounding leaves; where one is claimed, it holds."""
    trunk, tissue = block((2, 2, 2)), Tissue(theta=theta)
    start = held_turned(trunk, 40.0, axis=(1.0, 0.3, 1.0))
    for tolerance in (1e-3, 1e-7):
        model = model_of(trunk, tissue, precision="float32")
        ended, displacement = relax(model, start, tolerance=tolerance, max_steps=300)
        assert (ended.status is RelaxStatus.CONVERGED) == (tolerance == 1e-3)
        if ended.status is RelaxStatus.CONVERGED:
            assert Reference(trunk, tissue).error(displacement, 1e-9) <= 2.0 * ended.estimated_error


def test_what_is_on_the_way_is_not_claimed_and_to_judge_it_moves_no_node() -> None:
    trunk = block((2, 2, 2))
    relaxer = Relaxer(model_of(trunk, precision="float32"), RelaxOptions(tolerance=1e-3))
    relaxer.state.set_displacement(held_turned(trunk, 20.0))
    assert relaxer.relax(confirm=False).status is RelaxStatus.NEAR
    assert relaxer.relax(near=True).status is RelaxStatus.CONVERGED
    end = relaxer.state.host_displacement()
    assert Reference(trunk).error(end, 1e-6) <= 2e-3
    again = relaxer.relax(0.1, near=True)
    assert (again.status, again.steps) == (RelaxStatus.CONVERGED, 0)
    assert (relaxer.state.host_displacement() == end).all()


@pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])
@pytest.mark.parametrize(("cells", "tolerance"), [((2, 2, 2), 0.1), ((2, 2, 4), 1.0)])
def test_stiff_tissue_does_not_hide_how_far_soft_tissue_has_to_go(
    energy: str, cells: tuple[int, int, int], tolerance: float
) -> None:
    """Stiffness 1 : 1e4: a step along soft motions strains stiff ones, and the next solve has short vectors."""
    trunk, soft = block(cells), Tissue(epsilon=0.0, theta=0.0)
    upper = trunk.nodes[trunk.tets, 2].mean(axis=1) > trunk.nodes[:, 2].max() / 2.0
    trunk, stiff = (
        replace(trunk, tissue=upper.astype(np.int8)),
        replace(soft, youngs_modulus=1e4 * soft.youngs_modulus),
    )
    relaxer = Relaxer(model_of(trunk, [soft, stiff], energy=energy), RelaxOptions(tolerance=tolerance))
    relaxer.state.set_displacement(held_turned(trunk, 20.0, [3.0, 0.0, 1.0]))
    ended = relaxer.relax(confirm=False)
    claimed = relaxer.state.host_displacement()
    assert ended.status is RelaxStatus.NEAR
    assert relaxer.relax(1e-3).status is RelaxStatus.CONVERGED
    assert np.linalg.norm(relaxer.state.host_displacement() - claimed, axis=1).max() <= 2.0 * tolerance


COLUMN = column()


@pytest.mark.parametrize(
    ("precision", "beyond", "tolerance", "count"),
    [
        ("float32", 3.98107e-05, 0.01, 10),
        ("float32", 1e-7, 0.01, 10),
        ("float32", 2.3101297e-07, 0.01, 1),
        ("float64", 7.94328e-06, 0.01, 10),
        ("float64", 3.06e-06, 0.01, 5),
        ("float64", 6.26e-06, 0.01, 2),
    ],
)
def test_no_claim_is_false_next_to_buckling(precision: str, beyond: float, tolerance: float, count: int) -> None:
    """A column squeezed by a little more than its critical part: the straight one is a saddle."""
    path = np.zeros_like(COLUMN.nodes)
    path[:, 2] = -(0.16225501 + beyond) * COLUMN.nodes[:, 2]
    model = model_of(COLUMN, energy="neo-hookean", precision=precision)
    last = increments(model, path, count, tolerance=tolerance)[-1]
    reference = Continuum(COLUMN)
    curvature = np.linalg.eigvalsh(reference.hessian(last.displacement))[0]
    if precision == "float64":
        assert last.relaxation.status is RelaxStatus.CONVERGED
    if last.relaxation.status is RelaxStatus.CONVERGED:
        assert curvature > 0.0
        assert reference.error(last.displacement, 1e-3 * tolerance) <= 2.0 * last.relaxation.estimated_error
    else:
        assert last.relaxation.estimated_error == np.inf  # what claims nothing states no distance


def test_a_hessian_that_is_not_projected_is_not_used_as_one() -> None:
    """Crushed tissue, whose true Hessian was assembled for its sensitivities, and bones that go on from there."""
    trunk = block_with_bone((5, 3, 3), holes=((1, 1, 1), (3, 1, 1)))
    path = np.where((trunk.bone == 1)[:, None], [-14.0, 0.0, 0.0], 0.0)
    relaxer = Relaxer(model_of(trunk), RelaxOptions(tolerance=0.01, max_steps=100))
    relaxer.state.set_displacement(path)
    relaxer.assemble_true(relaxer.state.displacement)
    ended = relaxer.relax(confirm=False, reuse=True)
    assert ended.status is RelaxStatus.NEAR
    assert Reference(trunk).error(relaxer.state.host_displacement(), 1e-5) <= 2.0 * ended.estimated_error + 0.01


def test_a_relaxation_near_the_last_takes_the_hessian_that_was_prepared_there() -> None:
    trunk = block((3, 3, 5))
    reference, relaxer = Reference(trunk), Relaxer(model_of(trunk), RelaxOptions(tolerance=0.1))
    relaxer.state.set_displacement(held_turned(trunk, 10.0))
    relaxer.relax()
    relaxer.prepare()
    assert relaxer.work is not None
    version = relaxer.work.matrix_state.version
    bones = relaxer.state.host_displacement()
    bones[trunk.prescribed] = held_turned(trunk, 10.5)[trunk.prescribed]
    relaxer.state.set_displacement(bones)
    ended = relaxer.relax(confirm=False, reuse=True)
    assert (ended.status, relaxer.work.matrix_state.version) == (RelaxStatus.NEAR, version)
    assert ended.steps > 0
    assert reference.error(relaxer.state.host_displacement(), 1e-6) <= 0.1
