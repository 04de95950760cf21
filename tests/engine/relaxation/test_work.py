"""The matrix of a relaxation: which Hessian it holds, where it was taken, and when it is assembled."""

from __future__ import annotations

import numpy as np
import pytest

from support.meshes import block
from support.models import evaluated, held_turned, model_of, on_host
from warp_trunk.engine.linear import BlockMatrix
from warp_trunk.engine.work import Work

TRUNK = block((2, 2, 2))


def work_at(degrees: float) -> Work:
    work = Work(evaluated(model_of(TRUNK, energy="neo-hookean"), held_turned(TRUNK, 0.0)))
    move(work, degrees)
    return work


def move(work: Work, degrees: float) -> None:
    work.state.set_displacement(held_turned(TRUNK, degrees))
    work.evaluate()


def hessian(work: Work, true: bool) -> np.ndarray:
    """Assembled apart."""
    matrix = BlockMatrix(work.state)
    (matrix.assemble_true if true else matrix.assemble_projected)()
    return matrix.blocks.numpy()


@pytest.mark.parametrize("true", [False, True])
def test_the_matrix_follows_the_state_unless_an_earlier_one_will_do(true: bool) -> None:
    work = work_at(10.0)
    work.assemble(true=true)
    before = work.matrix.blocks.numpy().copy()
    np.testing.assert_array_equal(before, hessian(work, true))
    move(work, 25.0)
    work.assemble(true=true, fresh=False)
    np.testing.assert_array_equal(work.matrix.blocks.numpy(), before)
    work.assemble(true=true)
    np.testing.assert_array_equal(work.matrix.blocks.numpy(), hessian(work, true))
    work.assemble(true=not true, fresh=False)
    np.testing.assert_array_equal(work.matrix.blocks.numpy(), hessian(work, not true))
    assert not np.array_equal(hessian(work, true), hessian(work, not true))
    along = np.random.default_rng(3).normal(size=(work.state.model.free_nodes, 3))
    wanted = along.ravel() @ (on_host(work.matrix) @ along.ravel())
    assert work.curvature(along) == pytest.approx(wanted, rel=1e-10)


def test_rounding_is_that_of_the_largest_displacement_of_the_state() -> None:
    state = evaluated(model_of(TRUNK, threads=2), held_turned(TRUNK, 25.0))
    work = Work(state)
    work.evaluate()
    work.direction.fill_(100.0)
    work.attempt(1.0)
    work.accept()
    farthest = np.linalg.norm(state.displacement.numpy(), axis=1).max()
    assert farthest > 170.0
    assert state.rounding() == pytest.approx(10.0 * np.finfo(float).eps * farthest, rel=1e-12, abs=0.0)


def test_an_assembly_that_is_interrupted_leaves_no_hessian_that_holds() -> None:
    work = work_at(10.0)
    work.assemble(true=False)

    def interrupted() -> None:
        work.matrix.assemble_true()
        raise KeyboardInterrupt

    work._assemble_true = interrupted
    with pytest.raises(KeyboardInterrupt):
        work.assemble(true=True)
    assert not work.matrix_state.holds(False, None)
    work.assemble(true=False, fresh=False)
    np.testing.assert_array_equal(work.matrix.blocks.numpy(), hessian(work, true=False))


def test_grids_that_follow_a_hessian_are_those_at_rest_in_the_next_relaxation() -> None:
    work = work_at(25.0)
    rest = work.preconditioner._grids.numpy().copy()
    work.assemble(true=False, grids=True)
    assert work.matrix_state.grids_follow
    assert not np.array_equal(work.preconditioner._grids.numpy(), rest)
    move(work, 10.0)
    assert not work.matrix_state.grids_follow
    np.testing.assert_array_equal(work.preconditioner._grids.numpy(), rest)
