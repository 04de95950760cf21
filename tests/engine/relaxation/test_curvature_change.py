"""The remaining fraction of a step along a solution, against a gradient and a curvature written apart."""

import numpy as np
import pytest

from support.meshes import block_with_bone
from support.models import evaluated, model_of
from support.reference import Reference
from warp_trunk.engine.certify import HessianChange
from warp_trunk.engine.linear import BlockMatrix, ConjugateGradient
from warp_trunk.engine.multigrid import Multigrid
from warp_trunk.engine.state import State

TRUNK = block_with_bone((5, 3, 3), holes=((1, 1, 1),))


@pytest.fixture
def moved() -> tuple[State, ConjugateGradient, HessianChange, np.ndarray]:
    """A state that is not at rest, a solve for its gradient, and where it is in mesh order."""
    displacement = 0.02 * np.random.default_rng(3).normal(size=TRUNK.nodes.shape)
    state = evaluated(model_of(TRUNK), displacement)
    matrix = BlockMatrix(state)
    matrix.assemble_projected()
    preconditioner = Multigrid(matrix)
    matrix.assemble_true()
    solver = ConjugateGradient(matrix, preconditioner, state.gradient)
    assert not solver.solve(0.0, 1e-6).negative_curvature
    return state, solver, HessianChange(state, preconditioner, solver, state.gradient), displacement


def test_is_the_part_that_a_newton_step_leaves_of_the_gradient(moved) -> None:
    """A whole step takes the linear part of the gradient away: what is left of that is left of the step."""
    state, solver, change, displacement = moved
    reference, order = Reference(TRUNK), state.model.order[state.model.free]
    step = np.zeros_like(displacement)
    step[order] = solver.solution.numpy()
    before, left = (reference.gradient(displacement + s * step)[order] for s in (0.0, 1.0))
    found = change.part_left(1.0)  # before the solver is used for something else
    norms = [norm(vector, state, solver) for vector in (left, before)]
    assert found == pytest.approx(norms[0] / norms[1], rel=1e-3)


def test_falls_with_the_length_of_the_step_and_changes_nothing(moved) -> None:
    state, solver, change, _ = moved
    arrays = (state.displacement, state.gradient, solver.solution)
    before = [array.numpy().copy() for array in arrays]
    assert change.part_left(1e-3) == pytest.approx(0.1 * change.part_left(1e-2), rel=0.02)
    for array, values in zip(arrays, before, strict=True):
        assert (array.numpy() == values).all()


def norm(vector: np.ndarray, state: State, solver: ConjugateGradient) -> float:
    """The square root of v . M^-1 v, by the solver of the state with v in the place of its gradient."""
    gradient = state.gradient.numpy()
    gradient[: len(vector)] = vector
    state.gradient.assign(gradient)
    return solver.norm()
