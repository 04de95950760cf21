"""The work of solves and relaxations: a wrong weight or decision raises it while every result stays right."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from support.meshes import block_with_bone, column
from support.models import increments, model_of
from support.small_trunk import small_case
from warp_trunk.bone_motion.prescribed_motion import spline_path
from warp_trunk.engine.energies.by_name import EnergyName
from warp_trunk.engine.linear import BlockMatrix, ConjugateGradient
from warp_trunk.engine.multigrid import Multigrid
from warp_trunk.engine.parallel import Parallel
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.state import State
from warp_trunk.engine.tissue import SKIN_RIGIDITY
from warp_trunk.engine.trunk_mesh import TrunkMesh

LOAD_FACTORS = (0.1, 0.5, 1.0)
"""Parts of the correction whose gradients are solved for."""
ACCURACIES = [10.0**-digits for digits in range(1, 9)]
"""Of the solves of each: a solve tests convergence every fourth iteration, which many of them blur."""
HELD: dict[EnergyName, tuple[float, int]] = {"itmsm": (SKIN_RIGIDITY, 1752), "neo-hookean": (0.0, 544)}
"""Rigidity of the skin [N mm] and iterations of all solves by energy, on any machine."""
WITHIN = 0.04
"""Part of them by which a few last bits may change them."""


def iterations(energy: EnergyName, skin_rigidity: float) -> int:
    """Iterations of all solves, with the curvature at rest."""
    case, trunk = small_case()
    path = spline_path(trunk.nodes, case.landmarks_before, case.planned_landmarks, "cpu")
    state = State(model_of(trunk, energy=energy, skin_rigidity=skin_rigidity, device=Parallel("cpu", 2)))
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
    rigidity, wanted = HELD[energy]
    assert iterations(energy, rigidity) == pytest.approx(wanted, rel=WITHIN)


def crushed() -> tuple[TrunkMesh, np.ndarray]:
    """One of two bones is moved halfway onto the other."""
    trunk = block_with_bone((5, 3, 3), holes=((1, 1, 1), (3, 1, 1)))
    return trunk, np.where((trunk.bone == 1)[:, None], [-14.0, 0.0, 0.0], 0.0)


def buckled() -> tuple[TrunkMesh, np.ndarray]:
    """A column squeezed by a little more than its critical part."""
    trunk = column()
    return trunk, trunk.nodes * [0.0, 0.0, -0.16235501]


def corrected() -> tuple[TrunkMesh, np.ndarray]:
    """The small case."""
    case, trunk = small_case()
    return trunk, spline_path(trunk.nodes, case.landmarks_before, case.planned_landmarks, "cpu").displacement


@pytest.mark.parametrize(
    ("scene", "energy", "count", "tolerance", "wanted"),
    [
        (corrected, "itmsm", 4, 0.1, (8, 14, 210)),
        (corrected, "neo-hookean", 4, 0.1, (4, 9, 52)),
        (crushed, "itmsm", 3, 0.01, (27, 31, 380)),
        (crushed, "neo-hookean", 3, 0.01, (67, 95, 2712)),
        (buckled, "neo-hookean", 2, 0.01, (20, 28, 296)),
    ],
)
def test_increments_take_the_steps_evaluations_and_iterations_that_they_took(
    scene: Any, energy: EnergyName, count: int, tolerance: float, wanted: tuple[int, int, int]
) -> None:
    trunk, path = scene()
    ends = [
        each.relaxation for each in increments(model_of(trunk, energy=energy), path, count, tolerance=tolerance)
    ]
    assert ends[-1].status is RelaxStatus.CONVERGED
    spent = np.sum([(end.steps, end.evaluations, end.linear_iterations) for end in ends], axis=0)
    assert spent == pytest.approx(wanted, rel=0.1)
