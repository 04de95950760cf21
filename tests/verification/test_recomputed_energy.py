"""State's energies against eq. 4.6 of [2] summed over unique edges, unique faces and tetrahedra in NumPy."""

from typing import Any

import numpy as np
import pytest

from support.continuum import Continuum
from support.meshes import block, block_with_bone, rotation, single_tet
from support.models import bent_and_noisy, evaluated, gradient_of, half_and_half, model_of
from support.reference import Reference
from warp_trunk.engine.energies.itmsm import Itmsm
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh

MESHES = {"block": block(), "bone inside": block_with_bone(), "one tetrahedron": single_tet()}
TISSUES = {
    "all terms": Tissue(epsilon=0.7, theta=13.0, density=950.0, youngs_modulus=4.0),
    "edges only": Tissue(epsilon=0.0, theta=0.0),
    "no faces": Tissue(epsilon=0.0, theta=5.0),
    "no volume": Tissue(epsilon=2.0, theta=0.0),
}


@pytest.mark.parametrize("gravity", [0.0, 9.81])
@pytest.mark.parametrize(("precision", "bound"), [("float32", 1e-6), ("float64", 1e-12)])
@pytest.mark.parametrize("tissue", TISSUES)
@pytest.mark.parametrize("mesh", MESHES)
def test_energies_by_term(mesh: str, tissue: str, precision: str, bound: float, gravity: float) -> None:
    trunk = MESHES[mesh]
    displacement = bent_and_noisy(trunk)
    state = evaluated(model_of(trunk, TISSUES[tissue], gravity=gravity, precision=precision), displacement)
    found = state.energy()
    wanted = Reference(trunk, TISSUES[tissue], gravity).energies(displacement)
    for term, value in wanted.items():
        assert found.terms.get(term, 0.0) == pytest.approx(value, rel=bound, abs=0.0), term
    assert found.total == pytest.approx(sum(wanted.values()), rel=bound)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_counts_inverted_tetrahedra(precision: str) -> None:
    trunk = MESHES["block"]
    displacement = bent_and_noisy(trunk)
    points = trunk.nodes + displacement
    p = points[trunk.tets]
    turned = np.einsum("ij,ij->i", np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), p[:, 3] - p[:, 0]) <= 0.0
    assert 0 < turned.sum() < len(trunk.tets)
    state = evaluated(model_of(trunk, precision=precision), displacement)
    _, inverted, newly_inverted = state.read()
    assert (inverted, newly_inverted) == (turned.sum(), turned.sum())


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_gradient_of_all_nodes(threads: int) -> None:
    """The sum of the ranges' parts is the gradient of the NumPy energy, prescribed nodes included."""
    trunk, tissue = MESHES["bone inside"], TISSUES["all terms"]
    displacement = bent_and_noisy(trunk)
    state = evaluated(model_of(trunk, tissue, threads, gravity=9.81), displacement)
    found = gradient_of(state)
    wanted = Reference(trunk, tissue, 9.81).gradient(displacement)
    np.testing.assert_allclose(found, wanted, rtol=1e-11, atol=1e-11 * np.abs(wanted).max())


@pytest.mark.parametrize("energy", [Reference, Continuum])
def test_the_reference_gradient_is_that_of_the_reference_energy(energy: Any) -> None:
    trunk, rng = MESHES["block"], np.random.default_rng(1)
    tissue: Any = TISSUES["all terms"]
    if energy is Continuum:
        trunk, tissue = half_and_half(trunk), (tissue, Tissue(youngs_modulus=60.0, poisson_ratio=0.49))
    reference, displacement = energy(trunk, tissue, 9.81), bent_and_noisy(trunk)
    for _ in range(5):
        along = 1e-5 * rng.normal(size=displacement.shape)
        change = reference.energy(displacement + along) - reference.energy(displacement - along)
        assert change == pytest.approx(2.0 * float((reference.gradient(displacement) * along).sum()), rel=1e-7)


def test_no_force_and_no_torque_but_the_weight() -> None:
    """alpha M_total / (M_0 H_0) for each mm, and nothing that turns the trunk."""
    trunk, tissue = MESHES["block"], TISSUES["all terms"]
    displacement = bent_and_noisy(trunk)
    for gravity in (0.0, 9.81):
        state = evaluated(model_of(trunk, tissue, gravity=gravity), displacement)
        gradient, weight = gradient_of(state), np.zeros_like(displacement)
        if gravity:
            elements, volume = state.model.elements, Reference(trunk).rest_volumes
            assert isinstance(elements, Itmsm)
            share = elements.constants.alpha / (volume.mean() * np.ptp(trunk.nodes[:, 2]))
            assert gradient[:, 2].sum() == pytest.approx(share * volume.sum(), rel=1e-10)
            np.add.at(weight[:, 2], trunk.tets.ravel(), np.repeat(share * volume / 4.0, 4))
        scale, points = np.abs(gradient).max(), trunk.nodes + displacement
        np.testing.assert_allclose((gradient - weight).sum(axis=0), 0.0, atol=1e-11 * scale)
        np.testing.assert_allclose(np.cross(points, gradient - weight).sum(axis=0), 0.0, atol=1e-9 * scale)


def test_weight_in_newtons() -> None:
    """k_D / 2 [J] times the gradient along z is the tissue's weight m g [N]."""
    trunk = MESHES["block"]
    tissue = Tissue(density=1100.0, youngs_modulus=7.0)
    state = evaluated(model_of(trunk, tissue, gravity=9.81), np.zeros_like(trunk.nodes))
    reference = Reference(trunk)
    cubic_metres = reference.rest_volumes.sum() * 1e-9
    k_d = 5.0 * 7.0e3 * cubic_metres / len(reference.edges)
    per_metre = state.gradient.numpy()[:, 2].sum() * 1e3
    assert 0.5 * k_d * per_metre == pytest.approx(1100.0 * cubic_metres * 9.81, rel=1e-9)


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_relative_terms_do_not_know_the_scale(factor: float) -> None:
    trunk = MESHES["block"]
    displacement = bent_and_noisy(trunk)
    scaled = TrunkMesh(**{**trunk.__dict__, "nodes": factor * trunk.nodes})
    for precision, bound in (("float64", 1e-12), ("float32", 1e-5)):
        here = evaluated(model_of(trunk, precision=precision), displacement).energy()
        there = evaluated(model_of(scaled, precision=precision), factor * displacement).energy()
        for term in ("distance", "area", "volume"):
            assert there.terms[term] == pytest.approx(here.terms[term], rel=bound)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_rigid_motions_cost_nothing(precision: str) -> None:
    trunk = MESHES["block"]
    moved = trunk.nodes @ rotation(70.0, (1.0, -1.0, 3.0)).T + np.array([200.0, -50.0, 900.0])
    model = model_of(trunk, precision=precision)
    energy = evaluated(model, moved - trunk.nodes).energy()
    rounding = {"float32": 1e-4, "float64": 1e-13}[precision]
    assert energy.total < len(trunk.tets) * rounding**2 * 100.0
    assert evaluated(model, np.zeros_like(moved)).energy().total == 0.0
