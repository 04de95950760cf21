"""The work of the linear solver: wrong weights in the preconditioner raise it while every result stays right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from support.small_trunk import small_case
from warp_trunk.bone_motion.prescribed_motion import spline_path
from warp_trunk.engine import multigrid
from warp_trunk.engine.build import build_model
from warp_trunk.engine.dense_inverse import DenseInverse
from warp_trunk.engine.energies.by_name import EnergyName
from warp_trunk.engine.linear import BlockMatrix, ConjugateGradient
from warp_trunk.engine.multigrid import Multigrid
from warp_trunk.engine.node_groups import NodeGroups, tie
from warp_trunk.engine.state import State

LOAD_FACTORS = (0.1, 0.5, 1.0)
"""Parts of the correction whose gradients are solved for."""
ACCURACIES = [10.0**-digits for digits in range(1, 9)]
"""Of the solves of each: a solve tests convergence every fourth iteration, which many of them blur."""
HELD = {"itmsm": 1864, "neo-hookean": 544}
"""Iterations of all solves by energy, on any machine."""
WITHIN = 0.04
"""Part of them by which a few last bits may change them."""
SPOILT = 3.0
"""A wrong weight of the coarse correction that takes a tenth more; 1.5 takes no more than last bits may."""


def iterations(energy: EnergyName) -> int:
    """Iterations of all solves, with the curvature at rest."""
    case, trunk = small_case()
    path = spline_path(trunk.nodes, case.landmarks_before, case.planned_landmarks, "cpu")
    state = State(
        build_model(trunk, energy=energy, device="cpu", precision="float64", threads=2, skin_rigidity=0.0)
    )
    matrix = BlockMatrix(state)
    matrix.assemble_projected()
    solver = ConjugateGradient(matrix, Multigrid(matrix), state.gradient)
    spent = 0
    for load_factor in LOAD_FACTORS:
        state.set_displacement(path.at(load_factor))
        state.evaluate()
        spent += sum(solver.solve(0.0, accuracy).iterations for accuracy in ACCURACIES)
    return spent


@pytest.mark.parametrize("energy", HELD)
def test_linear_solves_take_the_iterations_that_they_took(energy: EnergyName) -> None:
    assert iterations(energy) == pytest.approx(HELD[energy], rel=WITHIN)


@pytest.mark.parametrize("energy", HELD)
def test_a_spoiled_coarse_correction_is_noticed(energy: EnergyName, monkeypatch: pytest.MonkeyPatch) -> None:
    invert = multigrid.invert

    def spoilt(matrix: np.ndarray) -> DenseInverse:
        inverse = invert(matrix)
        return replace(inverse, scale=SPOILT**0.5 * inverse.scale)

    monkeypatch.setattr(multigrid, "invert", spoilt)
    assert iterations(energy) > (1.0 + WITHIN) * HELD[energy]


def test_nodes_are_tied_by_their_stiffest_links_up_to_eight() -> None:
    size = 12
    rows = np.concatenate([np.arange(size), np.arange(size - 1)])
    columns = np.concatenate([np.arange(size), np.arange(1, size)])
    order = np.lexsort((columns, rows))
    links = np.concatenate([np.ones(size), [0.9, 0.3, *[0.5] * 8, 0.6]])  # 0-1, 2 to 10 in a row, 10-11 first
    groups = tie(rows[order], columns[order], (links[:, None, None] * np.eye(3))[order], size)
    assert groups == [[0, 1], [2, 3, 4, 5, 6, 7, 8, 9], [10, 11]]


def test_groups_of_tied_nodes_are_inverted_as_a_whole() -> None:
    """Against NumPy's solution of each group's block, which D^-1 alone does not give."""
    _, trunk = small_case()
    state = State(build_model(trunk, energy="itmsm", device="cpu", precision="float64", threads=2))
    matrix, model = BlockMatrix(state), state.model
    matrix.assemble_projected()
    groups = NodeGroups(matrix)
    groups.update()
    vector = np.random.default_rng(0).standard_normal((model.free_nodes, 3))
    groups.correct(model.array(vector, model.vec3))()
    columns, own = matrix.columns.numpy(), matrix.inverse_diagonal.numpy()
    rows = np.repeat(np.arange(model.free_nodes), np.diff(matrix.row_start.numpy()).astype(np.int64))
    dense = np.zeros((model.free_nodes, 3, model.free_nodes, 3))
    for row, column, block in zip(rows, columns, matrix.blocks.numpy(), strict=False):
        dense[row, :, column], dense[column, :, row] = block, block.T
    assert groups.members
    wanted = np.zeros_like(vector)
    for group in groups.members:
        block = dense[np.ix_(group, range(3), group, range(3))].reshape(3 * len(group), -1)
        solved = np.linalg.solve(block, vector[group].ravel()).reshape(-1, 3)
        wanted[group] = solved - (own[group] @ vector[group][:, :, None])[:, :, 0]
    corrections, members = groups.arrays.correction.numpy(), [node for group in groups.members for node in group]
    assert corrections == pytest.approx(wanted[members], rel=1e-4, abs=1e-4 * np.abs(wanted).max())
    assert groups.arrays.member_of.numpy()[members].tolist() == list(range(len(members)))
