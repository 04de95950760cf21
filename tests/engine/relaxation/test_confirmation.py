"""Claims of a relaxation at its end: no saddle, and the distance to the minimum of an energy written apart."""

import numpy as np
import pytest

from support.meshes import block, single_tet
from support.models import evaluated, held_turned, model_of, relax
from support.reference import Reference
from warp_trunk.engine.certify import Certificate, Step
from warp_trunk.engine.linear import BlockMatrix, LinearSolution
from warp_trunk.engine.multigrid import Multigrid
from warp_trunk.engine.newton import Newton, Relaxer
from warp_trunk.engine.relaxation import RelaxOptions, RelaxStatus
from warp_trunk.engine.tissue import Tissue


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
    state = evaluated(model_of(trunk, Tissue(epsilon=0.0, theta=0.0)), start)
    newton = Newton(state)
    newton.begin(0.01)
    newton._down = np.array([[0.0, 0.0, side]])
    newton.propose(None, 1.0)
    assert np.vdot(state.gradient.numpy()[0], newton.direction.numpy()[0]) < 0.0


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


@pytest.mark.parametrize(
    ("earlier", "wanted"), [([], 0.6 / 0.4), ([Step(0.8, 0.2)], 0.6 / 0.4), (None, 0.5 / 0.9)]
)
def test_the_distance_is_that_within_which_there_is_an_equilibrium(
    earlier: list[Step] | None, wanted: float
) -> None:
    """A step of 1 mm that left 0.6: of the newest as long as what is left, left / (1 - q), by hand."""
    model = model_of(block((1, 1, 2)))
    state = evaluated(model, np.zeros((len(model.order), 3)))
    matrix = BlockMatrix(state)
    certificate = Certificate(state, matrix, Multigrid(matrix))
    for step in [Step(5.0, 0.5)] if earlier is None else earlier:
        certificate.add(step)
    solution = LinearSolution(9, length=0.4, error=0.1, negative_curvature=False, norm=1.0, exhausted=False)
    last = None if earlier is None else Step(1.0, 0.6)
    assert certificate._reach(solution, last, 1.0, 0.4) == pytest.approx(wanted)
