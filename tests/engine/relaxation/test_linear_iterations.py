"""The work of the linear solver: wrong weights in the preconditioner raise it while every result stays right."""

from __future__ import annotations

import numpy as np
import pytest

from support.small_trunk import small_case
from warp_trunk.bone_motion.prescribed_motion import spline_path
from warp_trunk.engine import multigrid
from warp_trunk.engine.build import build_model
from warp_trunk.engine.energies.by_name import EnergyName
from warp_trunk.engine.grids import Interpolation, stiff_pairs
from warp_trunk.engine.linear import BlockMatrix, ConjugateGradient
from warp_trunk.engine.multigrid import Multigrid
from warp_trunk.engine.state import State

LOAD_FACTORS = (0.1, 0.5, 1.0)
"""Parts of the correction whose gradients are solved for."""
ACCURACIES = [10.0**-digits for digits in range(1, 9)]
"""Of the solves of each: a solve tests convergence every fourth iteration, which many of them blur."""
HELD = {"itmsm": 2192, "neo-hookean": 624}
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
    monkeypatch.setattr(multigrid, "invert", lambda *given: SPOILT * invert(*given))
    assert iterations(energy) > (1.0 + WITHIN) * HELD[energy]


def test_stiff_pairs_have_a_vertex_of_their_own() -> None:
    rows, columns = np.array([0, 0, 1, 1, 2, 2, 3]), np.array([0, 1, 1, 2, 2, 3, 3])
    links = np.array([1.0, 0.8, 1.0, 0.75, 1.0, 0.99, 1.0])  # 1 keeps its stiffest, 3 is tied too much
    pairs = stiff_pairs(rows, columns, links[:, None, None] * np.eye(3), 4)
    assert pairs.tolist() == [[0, 1]]
    grid = Interpolation(np.full((4, 8), 1), np.full((4, 8), 0.125), 2).with_pairs(pairs)
    constant = np.ones(grid.vertices)
    assert (constant[grid.vertex] * grid.weight).sum(axis=1) == pytest.approx(np.ones(4))
    assert [set(grid.vertex[node][grid.weight[node] > 0.0]) for node in range(4)] == [{2}, {2}, {1}, {1}]
