"""The matrix of a relaxation: which Hessian it holds, where it was taken, and when it is assembled."""

from __future__ import annotations

import numpy as np
import pytest

from support.meshes import block
from support.models import evaluated, held_turned, model_of
from warp_trunk.engine.work import Work

TRUNK = block((2, 2, 2))


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
    work = Work(evaluated(model_of(TRUNK, energy="neo-hookean"), held_turned(TRUNK, 10.0)))
    work.assemble(true=False)
    projected = work.matrix.blocks.numpy().copy()

    def interrupted() -> None:
        work.matrix.assemble_true()
        raise KeyboardInterrupt

    work._assemble_true = interrupted
    with pytest.raises(KeyboardInterrupt):
        work.assemble(true=True)
    assert not np.array_equal(work.matrix.blocks.numpy(), projected)
    work.assemble(true=False, fresh=False)
    np.testing.assert_array_equal(work.matrix.blocks.numpy(), projected)
