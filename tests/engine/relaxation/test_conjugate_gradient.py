"""The Newton system: the matrix and the solver, against SciPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp

from support.continuum import Continuum
from support.meshes import block_with_bone
from support.models import evaluated, model_of, on_host
from support.reference import Reference
from warp_trunk.engine.linear import BlockMatrix, ConjugateGradient, zero_dots
from warp_trunk.engine.multigrid import Multigrid
from warp_trunk.engine.outcome import Outcome
from warp_trunk.engine.state import State

TRUNK = block_with_bone((5, 3, 3), holes=((1, 1, 1), (3, 1, 1)))
NOISE = 0.3 * np.random.default_rng(1).normal(size=TRUNK.nodes.shape)


def stretched(threads: int = 2) -> tuple[State, BlockMatrix]:
    """A block whose nodes are not at rest, evaluated, in float64, and its projected Hessian."""
    state = evaluated(model_of(TRUNK, threads=threads), NOISE)
    matrix = BlockMatrix(state)
    matrix.assemble_projected()
    return state, matrix


@pytest.mark.parametrize("threads", [1, 3])
def test_the_matrix_multiplies(threads: int) -> None:
    state, matrix = stretched(threads)
    rows = len(matrix.inverse_diagonal)
    vector = np.random.default_rng(2).normal(size=(rows, 3))
    p, q = (wp.array(vector, dtype=wp.vec3d, device="cpu") for _ in range(2))
    dots = zero_dots(state.model)
    matrix.multiply(p, q, dots)()
    wanted = (on_host(matrix) @ vector.ravel()).reshape(rows, 3)
    np.testing.assert_allclose(q.numpy(), wanted, atol=1e-12 * np.abs(wanted).max())
    assert dots.products.numpy().sum() == pytest.approx((vector * wanted).sum(), rel=1e-12)


@pytest.mark.parametrize("short", [False, True])
def test_the_solution_is_that_of_a_dense_solve(short: bool) -> None:
    state, matrix = stretched()
    solver = ConjugateGradient(matrix, Multigrid(matrix), state.gradient)
    solution = solver.solve(absolute=1e-9, relative=0.0, short=short)
    right_side = -np.asarray(state.gradient.numpy(), dtype=np.float64)[: len(matrix.inverse_diagonal)]
    dense = np.asarray(on_host(matrix).todense())
    wanted = np.linalg.solve(dense, right_side.ravel()).reshape(-1, 3)
    assert np.linalg.norm(solver.solution.numpy() - wanted, axis=1).max() < 1e-8
    assert solution.length == pytest.approx(np.linalg.norm(wanted, axis=1).max(), rel=1e-6)
    assert solution.error <= 1e-9


@pytest.mark.parametrize("energy", [Reference, Continuum])
def test_the_true_curvature_is_that_of_numpy(energy: Any) -> None:
    trunk = block_with_bone((4, 3, 3), holes=((1, 1, 1),))
    noise = 0.3 * np.random.default_rng(1).normal(size=trunk.nodes.shape)
    name = "itmsm" if energy is Reference else "neo-hookean"
    state = evaluated(model_of(trunk, energy=name), noise)
    matrix = BlockMatrix(state)
    matrix.assemble_projected()
    positive = matrix.inverse_diagonal.numpy()
    matrix.assemble_true()
    model, reference = state.model, energy(trunk)
    place = np.searchsorted(reference.free, model.order[model.free])
    wanted = reference.hessian(noise).reshape(len(place), 3, len(place), 3)[place][:, :, place]
    assembled = np.asarray(on_host(matrix).todense()).reshape(wanted.shape)
    np.testing.assert_allclose(assembled, wanted, atol=1e-9 * np.abs(wanted).max())
    np.testing.assert_array_equal(matrix.inverse_diagonal.numpy(), positive)


def test_a_direction_of_negative_curvature_ends_a_solve() -> None:
    model = model_of(TRUNK)
    state = evaluated(model, -0.8 * TRUNK.nodes * ~TRUNK.prescribed[:, None])  # pressed together
    matrix = BlockMatrix(state)
    matrix.assemble_projected()
    solver = ConjugateGradient(matrix, Multigrid(matrix), state.gradient)
    assert solver.solve(1e-6, 0.0).outcome is Outcome.SOLVED
    matrix.assemble_true()
    dense = np.asarray(on_host(matrix).todense())
    assert np.linalg.eigvalsh(dense)[0] < 0.0
    assert solver.solve(1e-6, 0.0).outcome is Outcome.NEGATIVE_CURVATURE
    down = np.asarray(solver.search.numpy()).ravel()
    assert down @ dense @ down < 0.0
    gradient = np.asarray(state.gradient.numpy())[: len(matrix.inverse_diagonal)].ravel()
    assert gradient @ down < 0.0


def test_a_solve_that_goes_on_ends_where_a_longer_one_does() -> None:
    """To the last bit, its coefficients too."""
    state, matrix = stretched()
    solver = ConjugateGradient(matrix, Multigrid(matrix), state.gradient)
    assert solver.solve(1e-3, 0.1).iterations < 40
    assert solver.go_on(40).iterations == 40
    part, parts = solver.solution.numpy().copy(), solver.coefficients()
    assert solver.solve(1e-3, 0.1, 40).iterations == 40
    assert (part == solver.solution.numpy()).all()
    assert solver.solve(1e-3, 0.1, 36).iterations == 36
    solver.go_on(40)
    np.testing.assert_array_equal(parts, solver.coefficients())
    assert [len(each) for each in parts] == [40, 40]
    bounded = ConjugateGradient(matrix, Multigrid(matrix), state.gradient, most_iterations=8)
    assert bounded.solve(1e-9, 0.0).outcome is Outcome.EXHAUSTED
    state.gradient.fill_(np.nan)
    assert solver.solve(1e-9, 0.0).outcome is Outcome.UNSOUND
