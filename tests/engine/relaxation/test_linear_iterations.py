"""The work of solves and relaxations: a wrong weight or decision raises it while every result stays right."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from support.meshes import block_with_bone, column
from support.models import increments, model_of, on_host
from support.small_trunk import small_case
from warp_trunk.bone_motion.prescribed_motion import spline_path
from warp_trunk.engine.energies.by_name import EnergyName
from warp_trunk.engine.linear import BlockMatrix, ConjugateGradient
from warp_trunk.engine.multigrid import Multigrid
from warp_trunk.engine.node_groups import MEMBERS, STIFF, NodeGroups, tie
from warp_trunk.engine.parallel import Parallel
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.state import State
from warp_trunk.engine.tissue import SKIN_RIGIDITY
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.engine.work import Work

LOAD_FACTORS = (0.1, 0.5, 1.0)
"""Parts of the correction whose gradients are solved for."""
ACCURACIES = [10.0**-digits for digits in range(1, 9)]
"""Of the solves of each: a solve tests convergence every fourth iteration, which many of them blur."""
HELD = {"itmsm": 1784, "neo-hookean": 544}
"""Iterations of all solves by energy, on any machine."""
WITHIN = 0.04
"""Part of them by which a few last bits may change them."""


def iterations(energy: EnergyName) -> int:
    """Iterations of all solves, with the curvature at rest."""
    case, trunk = small_case()
    path = spline_path(trunk.nodes, case.landmarks_before, case.planned_landmarks, "cpu")
    state = State(model_of(trunk, energy=energy, device=Parallel("cpu", 2)))
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


def chain(stiffness: list[float], held: float) -> np.ndarray:
    """The matrix of nodes in a row, linked so, the last one held; shape (nodes, nodes)."""
    difference = np.diff(np.eye(len(stiffness) + 1), axis=0)
    matrix = difference.T @ np.diag(stiffness) @ difference
    matrix[-1, -1] += held
    return matrix


def tied(matrix: np.ndarray) -> list[list[int]]:
    rows, columns = np.nonzero(np.triu(matrix))
    return tie(rows, columns, matrix[rows, columns, None, None] * np.eye(3), len(matrix))


def test_a_thread_of_tissue_is_one_group_of_at_most_eight_nodes() -> None:
    """Soft links hold its pairs: by their own blocks alone, or held elsewhere, pairs are tied and no more."""
    thread = chain([10.0, 1.0, 10.0, 1.0, 10.0], held=0.1)
    assert tied(thread) == [[0, 1, 2, 3, 4, 5]]
    assert tied(thread + np.diag([0, 5.0, 5.0, 5.0, 5.0, 0])) == [[0, 1], [2, 3], [4, 5]]
    assert tied(chain([1.0] * 15, held=1.0))[0] == [*range(MEMBERS)]
    assert tied(chain([1.0] * 3, held=1.0) + 2.0 * np.eye(4)) == []


@pytest.mark.parametrize("seed", [1, 2])
def test_groups_are_tied_as_by_the_matrix_of_their_translations(seed: int) -> None:
    """The same choice by dense matrices, made again after each tie."""
    rng, size = np.random.default_rng(seed), 40
    soft = np.triu(10.0 ** rng.uniform(-2.0, 1.0, (size, size)) * (rng.random((size, size)) < 0.08), 1)
    matrix = np.diag((soft + soft.T).sum(axis=0) + rng.uniform(0.0, 0.2, size)) - soft - soft.T
    groups = [{node} for node in range(size)]

    def stiff_to(group: set[int]) -> list[tuple[float, set[int], set[int]]]:
        onto = np.array([[float(node in other) for other in groups] for node in range(size)])
        coarse, place = onto.T @ matrix @ onto, groups.index(group)
        part = np.abs(coarse[place]) / np.sqrt(coarse[place, place] * np.diag(coarse))
        return [(part[n], group, groups[n]) for n in np.flatnonzero(part > STIFF) if n != place]

    links = [link for group in groups for link in stiff_to(group)]
    groups = [group for group in groups if any(group == end for _, *ends in links for end in ends)]
    while links:
        link = max(links, key=lambda link: link[0])
        links.remove(link)
        a, b = (next(group for group in groups if end <= group) for end in link[1:])
        if a is not b and len(a | b) <= MEMBERS:
            groups = [group for group in groups if group not in (a, b)] + [a | b]
            links += stiff_to(groups[-1])
    wanted = sorted(sorted(group) for group in groups if len(group) > 1)
    assert max(map(len, wanted)) > 2
    assert tied(matrix) == wanted


def test_groups_of_tied_nodes_are_inverted_as_a_whole() -> None:
    """Against NumPy's solution of each group's block, which D^-1 alone does not give."""
    _, trunk = small_case()
    state = State(model_of(trunk, device=Parallel("cpu", 2), skin_rigidity=SKIN_RIGIDITY))
    matrix, model = BlockMatrix(state), state.model
    matrix.assemble_projected()
    groups = NodeGroups(matrix)
    groups.update()
    vector = np.random.default_rng(0).standard_normal((model.free_nodes, 3))
    groups.correct(model.array(vector, model.vec3))()
    dense = on_host(matrix).toarray().reshape(model.free_nodes, 3, model.free_nodes, 3)
    own = matrix.inverse_diagonal.numpy()
    assert groups.members
    wanted = np.zeros_like(vector)
    for group in groups.members:
        whole = dense[np.ix_(group, range(3), group, range(3))].reshape(3 * len(group), -1)
        solved = np.linalg.solve(whole, vector[group].ravel()).reshape(-1, 3)
        wanted[group] = solved - (own[group] @ vector[group][:, :, None])[:, :, 0]
    corrections, members = groups.arrays.correction.numpy(), [node for group in groups.members for node in group]
    assert corrections == pytest.approx(wanted[members], rel=1e-4, abs=1e-4 * np.abs(wanted).max())
    assert groups.arrays.member_of.numpy()[members].tolist() == list(range(len(members)))


def test_noise_is_larger_in_a_group_by_its_size() -> None:
    """As its block is at most that many times those of its nodes; by means over nodes in the norm of D."""
    _, trunk = small_case()
    work = Work(State(model_of(trunk, device=Parallel("cpu", 2), skin_rigidity=SKIN_RIGIDITY)))
    work.certificate._color()
    noise, size = work.solver.noise.numpy(), np.ones(work.state.model.free_nodes, dtype=int)
    for group in work.preconditioner.groups.members:
        size[group] = len(group)
    squares = np.einsum("ni,nij,nj->n", noise, work.matrix.inverse_diagonal.numpy(), noise) / 3.0
    for grouped in (False, True):
        chosen = (squares / size)[(size > 1) == grouped]
        assert abs(chosen.mean() - 1.0) < 3.0 * (2.0 / 3.0 / len(chosen)) ** 0.5 < 0.5
