"""A trunk whose skin resists bending: its matrix, rigid motions, gravity, and what is smoother for it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from support.meshes import block_with_bone, rotate, rotation, with_skin
from support.models import evaluated, increments, model_of, on_host, settle
from warp_trunk.engine.linear import BlockMatrix
from warp_trunk.engine.model import Model
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.sag_free import sag_free
from warp_trunk.engine.trunk_mesh import TrunkMesh

TRUNK = with_skin(block_with_bone((4, 4, 5), holes=((1, 2, 1), (2, 1, 3))))
ENERGIES = ("itmsm", "neo-hookean")
RIGIDITY = 30.0
"""Of a skin about as stiff as a cell of the tissue [N mm]."""


def skinned(trunk: TrunkMesh = TRUNK, **options: Any) -> Model:
    return model_of(trunk, **{"threads": 1, "skin_rigidity": RIGIDITY, **options})


@pytest.mark.parametrize(("energy", "threads"), [("itmsm", 2), ("neo-hookean", 1)])
def test_the_matrix_is_that_of_differences_of_the_gradient(energy: str, threads: int) -> None:
    model = skinned(energy=energy, threads=threads)
    assert model.terms[-1] == "bending"
    random = np.random.default_rng(1)
    state = evaluated(model, 0.5 * random.normal(size=TRUNK.nodes.shape))
    matrix = BlockMatrix(state)
    matrix.assemble_true()
    assert state.energy().terms["bending"] > 0.1 * state.energy().total
    start, along = state.displacement.numpy().copy(), np.zeros((model.nodes, 3))
    along[model.free] = random.normal(size=(model.free_nodes, 3))
    ends = []
    for sign in (1.0, -1.0):
        state.set_from_rest(start + sign * 1e-6 * along)
        state.evaluate()
        ends.append((state.energy().total, state.gradient.numpy().copy()))
    (high, up), (low, down) = ends
    slope = np.vdot(0.5 * (up + down), along)
    assert (high - low) / 2e-6 == pytest.approx(slope, rel=1e-6)
    wanted = ((up - down) / 2e-6)[model.free].ravel()
    product = on_host(matrix).toarray() @ along[model.free].ravel()
    np.testing.assert_allclose(product, wanted, atol=1e-6 * np.abs(wanted).max())


@pytest.mark.parametrize("energy", ENERGIES)
def test_a_trunk_that_moves_as_a_whole_moves_rigidly_and_else_stays(energy: str) -> None:
    moved = TRUNK.nodes @ rotation(40.0, (1.0, 2.0, -0.5)).T + [5.0, -3.0, 20.0] - TRUNK.nodes
    last = settle(skinned(energy=energy), moved, 2, tolerance=1e-6)
    np.testing.assert_allclose(last.displacement, moved, atol=1e-5)
    assert last.relaxation.energy.total < 1e-9
    still = settle(skinned(energy=energy), 0.0 * moved, tolerance=1e-6)
    assert np.abs(still.displacement).max() < 1e-12


def test_the_scan_stands_under_gravity() -> None:
    """The skin, too, is at rest where gravity pulls the trunk into the scan from, and there bends."""
    hung = sag_free(skinned(energy="neo-hookean", gravity=9.81), tolerance=1e-7).model
    assert hung.scan is not None
    assert np.abs(hung.scan).max() > 0.01
    last = settle(hung, np.zeros_like(TRUNK.nodes))
    assert np.abs(last.displacement).max() < 1e-5
    assert last.relaxation.energy.terms["bending"] > 1e-8


@pytest.mark.parametrize(("energy", "rigidity"), [("itmsm", RIGIDITY), ("neo-hookean", 1e4)])
def test_the_distance_reported_in_float32_is_not_below_the_true_one(energy: str, rigidity: float) -> None:
    """Against float64, up to a skin that is far stiffer than the tissue; where float32 has no digits for the end,
    the simulation continues in float64."""
    move, ends = 0.3 * (rotate(TRUNK.nodes, 12.0, (0.3, 1.0, 0.2)) - TRUNK.nodes), []
    for precision, tolerance in (("float64", 1e-6), ("float32", 0.01), ("float32", 1e-6)):
        model = skinned(energy=energy, skin_rigidity=rigidity, precision=precision)
        ends += increments(model, move, tolerance=tolerance)
    exact, reported = ends[0].displacement, ends[1].relaxation.estimated_error
    assert [increment.relaxation.status for increment in ends[:2]] == [RelaxStatus.CONVERGED] * 2
    assert np.linalg.norm(ends[1].displacement - exact, axis=1).max() < reported <= 0.01
    last = ends[2].relaxation
    assert (ends[2].relaxer.model.precision, last.status) == ("float64", RelaxStatus.CONVERGED)
    assert last.steps == len(last.history)
    assert (ends[2].displacement == move)[TRUNK.prescribed].all()
    assert np.linalg.norm(ends[2].displacement - exact, axis=1).max() < 2e-6
