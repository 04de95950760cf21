"""Conjugate gradients on several columns, against the solver of one and against SciPy."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from support.meshes import block_with_bone
from support.threads import split_launches
from warp_trunk.engine.model import build_model
from warp_trunk.engine.relaxation.block_matrix import BlockMatrix
from warp_trunk.engine.relaxation.column_gradient import ColumnGradient
from warp_trunk.engine.relaxation.columns import Columns
from warp_trunk.engine.relaxation.conjugate_gradient import ConjugateGradient
from warp_trunk.engine.relaxation.dots import Dots
from warp_trunk.engine.relaxation.multilevel import Multilevel
from warp_trunk.engine.state import State

TRUNK = block_with_bone((7, 5, 5), holes=((1, 2, 2), (5, 2, 2)))


def stretched(
    precision: str = "float64", threads: int = 2, pressed: float = 0.0
) -> tuple[BlockMatrix, Multilevel]:
    """The curvature of a block whose nodes are not at rest, and its preconditioner."""
    state = State(build_model(TRUNK, device=split_launches(threads), precision=precision))
    noise = np.random.default_rng(1).normal(size=TRUNK.nodes.shape)
    state.place(0.3 * noise if not pressed else -pressed * TRUNK.nodes * ~TRUNK.prescribed[:, None])
    matrix = BlockMatrix(state)
    matrix.assemble()
    return matrix, Multilevel(matrix)


def drawn(matrix: BlockMatrix, count: int) -> np.ndarray:
    size = matrix.model.free_nodes
    return np.random.default_rng(5).normal(size=(count, size, 3)) * 10.0 ** (np.arange(count) % 5)[:, None, None]


def one_by_one(matrix: BlockMatrix, preconditioner: Multilevel, right: np.ndarray, relative: float) -> list:
    """Each column by the solver of one: how it ended, and x."""
    model, found = matrix.model, []
    load = model.free_vectors()
    solver = ConjugateGradient(matrix, preconditioner, load)
    for column in right:
        load.assign(-column)
        found.append((solver.solve(0.0, relative), solver.solution.numpy().astype(np.float64), solver))
    return found


def dense(matrix: BlockMatrix) -> np.ndarray:
    """The matrix, by its product with every unit vector."""
    model = matrix.model
    size = model.free_nodes
    p, q = model.free_vectors(), model.free_vectors()
    multiply = matrix.multiply(p, q, Dots.unread(model))
    columns = []
    for unit in np.eye(3 * size):
        p.assign(unit.reshape(size, 3))
        multiply()
        columns.append(q.numpy().ravel().copy())
    return np.array(columns).T


@pytest.mark.parametrize("count", [1, 3, 11, 19, 40])
def test_fields_are_written_and_read(count: int) -> None:
    matrix, _ = stretched()
    layout, values = Columns(matrix.model, count), drawn(matrix, count)
    field = layout.field(matrix.model.free_nodes)
    factor = 2.0 ** np.arange(count)
    layout.write(field, values, factor)
    np.testing.assert_array_equal(layout.read(field, 1.0 / factor), values)
    layout.write(field, values[:1], factor[:1])
    np.testing.assert_array_equal(layout.read(field, np.ones(count))[1:], 0.0)


@pytest.mark.parametrize("threads", [1, 3])
def test_the_matrix_and_the_preconditioner_take_every_column(threads: int) -> None:
    matrix, preconditioner = stretched(threads=threads)
    model, values = matrix.model, drawn(matrix, 11)
    layout = Columns(model, 11)
    p, q, z = (layout.field(model.free_nodes) for _ in range(3))
    layout.write(p, values, np.ones(11))
    # one field takes the dense inverse in 16 bits, which keep 0.999 of what is not on its diagonal
    for record, out, within in ((matrix.multiply_columns, q, 1e-12), (preconditioner.apply_columns, z, 4e-3)):
        dots = layout.products()
        record(layout, p, out, dots)()
        one_in, one_out, one_dots = model.free_vectors(), model.free_vectors(), Dots.unread(model)
        one = (matrix.multiply if out is q else preconditioner.apply)(one_in, one_out, one_dots)
        found = layout.read(out, np.ones(11))
        sums = dots.numpy().sum(axis=0).ravel()[:11]
        for column, values_in in enumerate(values):
            one_in.assign(values_in)
            one()
            wanted = one_out.numpy()
            np.testing.assert_allclose(found[column], wanted, rtol=0.0, atol=within * np.abs(wanted).max())
            assert sums[column] == pytest.approx(np.vdot(values_in, found[column]), rel=1e-10)


@pytest.mark.parametrize(("precision", "rtol"), [("float64", 1e-8), ("float32", 2e-4)])
@pytest.mark.parametrize("count", [1, 2, 19])
def test_columns_are_solved_as_one_by_one(count: int, precision: str, rtol: float) -> None:
    matrix, preconditioner = stretched(precision)
    right = drawn(matrix, count)
    relative = 1e-3 * rtol**0.5
    found = ColumnGradient(matrix, preconditioner, count).solve(right, relative)
    for column, (solution, x, _) in enumerate(one_by_one(matrix, preconditioner, right, relative)):
        scale = np.abs(x).max()
        np.testing.assert_allclose(found.columns[column], x, rtol=0.0, atol=rtol * scale)
        assert abs(int(found.iterations[column]) - solution.iterations) <= (0 if precision == "float64" else 8)
        assert found.longest[column] == pytest.approx(solution.longest, rel=10.0 * rtol)
    assert not found.bent.any()


def test_columns_are_solutions() -> None:
    matrix, preconditioner = stretched()
    right = drawn(matrix, 9)
    found = ColumnGradient(matrix, preconditioner, 9).solve(right, 1e-9)
    wanted = np.linalg.solve(dense(matrix), right.reshape(9, -1).T).T.reshape(right.shape)
    for x, solution in zip(found.columns, wanted, strict=True):
        assert np.abs(x - solution).max() < 1e-8 * np.abs(solution).max()


def test_a_column_of_zeros_and_a_column_less() -> None:
    matrix, preconditioner = stretched()
    right = drawn(matrix, 4)
    right[2] = 0.0
    solver = ColumnGradient(matrix, preconditioner, 5)
    found = solver.solve(right, 1e-8)
    assert len(found.columns) == 4
    assert not found.columns[2].any()
    assert found.longest[2] == found.left[2] == 0.0
    again = solver.solve(right[:2], 1e-8)  # nothing is left of the solve before
    np.testing.assert_array_equal(again.columns, found.columns[:2])


def test_a_column_goes_on_from_a_guess() -> None:
    matrix, preconditioner = stretched()
    right = drawn(matrix, 3)
    solver = ColumnGradient(matrix, preconditioner, 3)
    whole = solver.solve(right, 1e-8)
    there = solver.solve(right, 1e-6, guess=whole.columns * [[[1.0]], [[1.001]], [[0.0]]])
    np.testing.assert_allclose(there.columns[2], whole.columns[2], atol=1e-5 * np.abs(whole.columns[2]).max())
    assert there.iterations[1] <= there.iterations[2]


def test_negative_curvature_ends_its_column_alone() -> None:
    matrix, preconditioner = stretched(pressed=0.8)
    matrix.assemble_true()
    hessian = dense(matrix)
    values, vectors = np.linalg.eigh(hessian)
    assert values[0] < 0.0 < values[-1]
    right = np.array([vectors[:, 0], vectors[:, -1], np.zeros(len(hessian))]).reshape(3, -1, 3)
    found = ColumnGradient(matrix, preconditioner, 3).solve(right, 1e-6)
    alone = one_by_one(matrix, preconditioner, right, 1e-6)
    assert found.bent.tolist() == [solution.bent for solution, _, _ in alone]
    assert found.bent[0]
    assert not found.bent[2]


def test_what_is_no_number_has_infinite_length() -> None:
    matrix, preconditioner = stretched()
    right = drawn(matrix, 2)
    right[0, 0, 0] = np.nan
    found = ColumnGradient(matrix, preconditioner, 2).solve(right, 1e-8)
    assert np.isinf(found.longest[0])
    np.testing.assert_allclose(
        found.columns[1], ColumnGradient(matrix, preconditioner, 1).solve(right[1:], 1e-8).columns[0], rtol=1e-12
    )


@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device")
def test_cuda_gives_the_same() -> None:
    matrix, preconditioner = stretched()
    on_cuda = State(build_model(TRUNK, device="cuda:0", precision="float64"))
    on_cuda.place(0.3 * np.random.default_rng(1).normal(size=TRUNK.nodes.shape))
    other = BlockMatrix(on_cuda)
    other.assemble()
    right = drawn(matrix, 19)
    wanted = ColumnGradient(matrix, preconditioner, 19).solve(right, 1e-9).columns
    found = ColumnGradient(other, Multilevel(other), 19).solve(right, 1e-9).columns
    for one, same in zip(found, wanted, strict=True):
        np.testing.assert_allclose(one, same, rtol=0.0, atol=1e-7 * np.abs(same).max())
