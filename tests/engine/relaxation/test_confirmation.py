"""Claims of a relaxation at its end: no saddle, and the distance to the minimum of an energy written apart."""

from dataclasses import replace

import numpy as np
import pytest

from support.continuum import Continuum
from support.meshes import block, block_with_bone, column, single_tet
from support.models import evaluated, held_turned, increments, model_of, relax
from support.reference import Reference
from warp_trunk.engine.newton import Relaxer
from warp_trunk.engine.relaxation import RelaxOptions, RelaxStatus, RelaxStep
from warp_trunk.engine.state import State
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.work import Work


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_saddle_is_left_although_no_force_points_away_from_it(precision: str) -> None:
    """A corner held by three edges lies in the plane of their ends: there it is pressed, but not out of it."""
    trunk, edges = single_tet(), Tissue(epsilon=0.0, theta=0.0)
    start = np.zeros_like(trunk.nodes)
    start[3] = [2.0, 2.0, -10.0]
    reference = Reference(trunk, edges)
    assert reference.gradient(start)[3, 2] == 0.0
    model = model_of(trunk, edges, precision=precision)
    ended, found = relax(model, start, tolerance=0.01, max_steps=300)
    assert ended.status is RelaxStatus.CONVERGED
    assert abs(trunk.nodes[3, 2] + found[3, 2]) > 5.0
    assert np.linalg.eigvalsh(reference.hessian(found))[0] > 0.0
    assert reference.error(found) <= 2.0 * ended.estimated_error


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


@pytest.mark.parametrize("theta", [0.0, 10.0, 1000.0])
def test_rounding_is_part_of_the_distance(theta: float) -> None:
    """In float32 no tolerance is claimed below what rounding leaves; where one is claimed, it holds."""
    trunk, tissue = block((2, 2, 2)), Tissue(theta=theta)
    start = held_turned(trunk, 40.0, axis=(1.0, 0.3, 1.0))
    for tolerance in (1e-3, 1e-4, 1e-7):
        model = model_of(trunk, tissue, precision="float32")
        ended, found = relax(model, start, tolerance=tolerance, max_steps=300)
        if tolerance in (1e-3, 1e-7):
            assert (ended.status is RelaxStatus.CONVERGED) == (tolerance == 1e-3)
        if ended.status is RelaxStatus.CONVERGED:
            assert Reference(trunk, tissue).error(found, 1e-9) <= 2.0 * ended.estimated_error


def test_what_is_on_the_way_is_not_claimed() -> None:
    trunk = block((2, 2, 2))
    relaxer = Relaxer(model_of(trunk, precision="float32"), RelaxOptions(tolerance=1e-3))
    relaxer.state.set_displacement(held_turned(trunk, 20.0))
    assert relaxer.relax(confirm=False).status is RelaxStatus.NEAR
    assert relaxer.relax(near=True).status is RelaxStatus.CONVERGED
    assert Reference(trunk).error(relaxer.state.host_displacement(), 1e-6) <= 2e-3


@pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])
@pytest.mark.parametrize("cells", [(2, 2, 2), (2, 2, 4), (3, 2, 4)])
def test_stiff_tissue_does_not_hide_how_far_soft_tissue_has_to_go(
    energy: str, cells: tuple[int, int, int]
) -> None:
    """Stiffness 1 : 1e4: a step along soft motions strains stiff ones, and the next solve has short vectors."""
    trunk, soft = block(cells), Tissue(epsilon=0.0, theta=0.0)
    upper = trunk.nodes[trunk.tets, 2].mean(axis=1) > trunk.nodes[:, 2].max() / 2.0
    trunk, stiff = (
        replace(trunk, tissue=upper.astype(np.int8)),
        replace(soft, youngs_modulus=1e4 * soft.youngs_modulus),
    )
    relaxer = Relaxer(model_of(trunk, [soft, stiff], energy=energy), RelaxOptions(tolerance=0.1))
    relaxer.state.set_displacement(held_turned(trunk, 20.0, [3.0, 0.0, 1.0]))
    ended = relaxer.relax(confirm=False)
    claimed = relaxer.state.host_displacement()
    assert ended.status is RelaxStatus.NEAR
    assert relaxer.relax(1e-3).status is RelaxStatus.CONVERGED
    assert np.linalg.norm(relaxer.state.host_displacement() - claimed, axis=1).max() <= 0.2


COLUMN = column()


@pytest.mark.parametrize(
    ("precision", "beyond", "tolerance", "count"),
    [
        ("float32", 7.94328e-05, 0.1, 5),
        ("float32", 3.98107e-05, 0.01, 10),
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
    curvature = np.linalg.eigvalsh(Continuum(COLUMN).hessian(last.displacement))[0]
    if precision == "float64":
        assert last.relaxation.status is RelaxStatus.CONVERGED
    if last.relaxation.status is RelaxStatus.CONVERGED:
        assert curvature > 0.0
    else:
        assert last.relaxation.estimated_error == np.inf  # what claims nothing states no distance


def test_to_judge_moves_no_node() -> None:
    trunk = block((2, 2, 2))
    relaxer = Relaxer(model_of(trunk, precision="float32"), RelaxOptions(tolerance=1e-3))
    relaxer.state.set_displacement(held_turned(trunk, 20.0))
    relaxer.relax()
    before = relaxer.state.displacement.numpy().copy()
    again = relaxer.relax(0.1, near=True)
    assert (again.status, again.steps) == (RelaxStatus.CONVERGED, 0)
    assert (relaxer.state.displacement.numpy() == before).all()


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


def test_the_distance_of_a_step_is_that_of_where_it_led() -> None:
    trunk = block((2, 2, 3))
    relaxer = Relaxer(model_of(trunk), RelaxOptions(tolerance=1e-3))
    relaxer.state.set_displacement(held_turned(trunk, 15.0))
    seen: list[tuple[float, float]] = []
    reference = Reference(trunk)

    def watch(step: RelaxStep, state: State) -> None:
        seen.append((step.estimated_error, reference.error(state.host_displacement(), 1e-7)))

    ended = relaxer.relax(watch=watch)
    assert ended.status is RelaxStatus.CONVERGED
    assert len(seen) == ended.steps > 2
    for reported, true in seen[1:]:
        assert true <= 2.0 * reported
        assert reported <= 10.0 * true + 1e-4
