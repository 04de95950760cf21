"""The rest state that gravity pulls into the scan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from support.continuum import Continuum
from support.meshes import block_with_bone, grid, rotate, trunk, with_skin
from support.models import evaluated, model_of, relax, settle
from support.reference import Reference
from warp_trunk.engine.model import Model
from warp_trunk.engine.sag_free import LEAST_VOLUME, sag_free
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh, tet_volumes
from warp_trunk.errors import InputError

GRAVITY = 9.81
BARE = block_with_bone()
STILL = np.zeros_like(BARE.nodes)
ENERGIES = pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])


def at_rest(model: Model) -> TrunkMesh:
    """The mesh at the model's rest state."""
    nodes = np.empty_like(BARE.nodes)
    nodes[model.order] = model.rest
    return replace(BARE, nodes=nodes)


def standing(energy: str = "itmsm", youngs_modulus: float = 3.0) -> Model:
    """Tissue around a bone, so soft that its shape at rest is millimetres away, and stiff enough to stand."""
    return model_of(BARE, Tissue(youngs_modulus=youngs_modulus), energy=energy, gravity=GRAVITY)


@ENERGIES
def test_without_surgery_nothing_changes(energy: str) -> None:
    """Also where nodes come off the bone."""
    model = standing(energy)
    rest_state = sag_free(model, tolerance=1e-4)
    assert rest_state.error <= 1e-4
    assert np.linalg.norm(settle(model, STILL, tolerance=1e-4).displacement, axis=1).max() > 0.3
    released = rest_state.model.released(np.flatnonzero(BARE.prescribed)[:2])
    for held, count in ((rest_state.model, 1), (rest_state.model, 3), (released, 1)):
        end = settle(held, STILL, count, tolerance=1e-4).displacement
        assert np.linalg.norm(end, axis=1).max() < 3e-4
    least = LEAST_VOLUME * tet_volumes(BARE.nodes, BARE.tets)
    assert (tet_volumes(at_rest(rest_state.model).nodes, BARE.tets) > least).all()


def test_the_scan_is_in_equilibrium_by_another_account() -> None:
    """Forces at the scan by the independent energy, with lengths, areas and volumes of the rest state found."""
    mesh = at_rest(sag_free(standing(), tolerance=1e-6).model)
    other = Reference(mesh, Tissue(youngs_modulus=3.0), gravity=GRAVITY)
    other.node_weight *= other.rest_volumes.sum() / tet_volumes(BARE.nodes, BARE.tets).sum()  # k_D of the scan
    force = other.gradient(BARE.nodes - mesh.nodes)[other.free]
    assert np.abs(force).max() < 1e-4 * other.node_weight.max()


def test_a_column_is_longer_at_rest_by_what_its_weight_presses_it_together() -> None:
    """Without sideways strain (Poisson's ratio 0) a column of height L sags by rho g L^2 / 2 E at its top."""
    nodes, tets, _ = grid((2, 2, 6), 10.0)
    tissue = Tissue(youngs_modulus=100.0, poisson_ratio=0.0)
    column = model_of(trunk(nodes, tets, nodes[:, 2] == 0.0), tissue, energy="neo-hookean", gravity=GRAVITY)
    sag = 1000.0 * GRAVITY * 0.060**2 / (2.0 * 100e3) * 1e3
    model = sag_free(column, tolerance=1e-5).model
    assert model.scan is not None
    assert -model.scan[model.rest[:, 2] > 59.0, 2].mean() == pytest.approx(sag, rel=0.01)


def test_surgery_is_measured_from_the_scan_whatever_the_increments() -> None:
    model = sag_free(standing()).model
    path = 0.02 * (rotate(BARE.nodes, 30.0, (1.0, 2.0, 0.5)) - BARE.nodes) + [0.0, 0.0, 1.0]
    at_once, four = (settle(model, path, count, tolerance=1e-4).displacement for count in (1, 4))
    assert np.abs(at_once - four).max() < 1e-3
    assert (at_once[BARE.prescribed] == path[BARE.prescribed]).all()
    assert np.abs(relax(model, path, tolerance=1e-4)[1] - at_once).max() < 1e-3


def test_the_model_given_is_left_as_it_is_and_without_gravity_there_is_nothing_to_find() -> None:
    model = model_of(with_skin(BARE), gravity=GRAVITY, skin_rigidity=30.0)
    assert model.skin is not None
    measures = {"rest_edge": model.elements, "rest_volume": model.elements, "rest_angle": model.skin}
    before = {name: getattr(part, name).numpy().copy() for name, part in measures.items()}
    assert sag_free(model).model.scan is not None
    assert model.scan is None
    for name, part in measures.items():
        np.testing.assert_array_equal(getattr(part, name).numpy(), before[name])
    rest_state = sag_free(plain := model_of(BARE))
    assert (rest_state.model, rest_state.rounds) == (plain, 0)


def test_the_scan_is_a_minimum_or_the_rest_state_is_refused() -> None:
    """By the dense second derivative of an energy written apart; gravity adds nothing to it."""
    with pytest.raises(InputError, match=r"^gravity: no rest state .* of 0\.01 kPa .* raise youngs_modulus"):
        sag_free(standing("itmsm", 0.01))
    for energy in ("itmsm", "neo-hookean"):
        with pytest.raises(InputError, match=r"tissue of 1 kPa does not come to rest .* but buckles .*; raise "):
            sag_free(standing(energy, 1.0))
    model = sag_free(standing("neo-hookean", 1.5)).model
    rest = at_rest(model)
    hessian = Continuum(rest, model.tissues[0]).hessian(BARE.nodes - rest.nodes)
    assert np.linalg.eigvalsh(hessian)[0] > 0.0


def test_gravity_has_the_energy_of_the_masses_where_they_are() -> None:
    """m g z of the masses of the rest state at the heights of the scan, above the lowest node at rest, in mJ."""
    model = sag_free(standing("neo-hookean")).model
    rest = at_rest(model).nodes
    mass = 1000e-9 * tet_volumes(rest, BARE.tets)
    heights = BARE.nodes[BARE.tets][:, :, 2].mean(axis=1) - rest[:, 2].min()
    terms = evaluated(model, STILL).energy().terms
    assert terms["gravity"] == pytest.approx(GRAVITY * mass @ heights, rel=1e-12)
