"""State's energies and gradients against NumPy: eq. 4.6 of [2] over unique features, and neo-Hookean."""

from typing import Any

import numpy as np
import pytest

from support.continuum import Continuum
from support.meshes import block, block_with_bone, rotation, single_tet
from support.models import bent_and_noisy, evaluated, gradient_of, half_and_half, model_of
from support.reference import Reference
from warp_trunk.engine.state import State
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh

MESHES = {"block": block(), "bone inside": block_with_bone(), "one tetrahedron": single_tet()}
TISSUES = {
    "all terms": Tissue(epsilon=0.7, theta=13.0, density=950.0, youngs_modulus=4.0),
    "edges only": Tissue(epsilon=0.0, theta=0.0),
    "no faces": Tissue(epsilon=0.0, theta=5.0),
    "no volume": Tissue(epsilon=2.0, theta=0.0),
}
LAYERS = (
    Tissue(youngs_modulus=10.0, poisson_ratio=0.4, density=900.0),
    Tissue(youngs_modulus=60.0, poisson_ratio=0.49, density=1200.0),
)
REFERENCES: dict[str, Any] = {"itmsm": Reference, "neo-hookean": Continuum}
each_energy = pytest.mark.parametrize("energy", REFERENCES)


def state_of(trunk: TrunkMesh, tissue: Any, displacement: np.ndarray, **options: Any) -> State:
    return evaluated(model_of(trunk, tissue, **options), displacement)


@pytest.mark.parametrize("gravity", [0.0, 9.81])
@pytest.mark.parametrize(("precision", "bound"), [("float32", 3e-6), ("float64", 1e-12)])
@pytest.mark.parametrize(
    ("energy", "mesh", "tissue"),
    [
        *(("itmsm", mesh, tissue) for mesh in MESHES for tissue in TISSUES.values()),
        ("neo-hookean", "bone inside", LAYERS[0]),
        ("neo-hookean", "bone inside", LAYERS),
    ],
)
def test_terms_and_inverted_tetrahedra(
    energy: str, mesh: str, tissue: Any, precision: str, bound: float, gravity: float
) -> None:
    trunk = half_and_half(MESHES[mesh]) if tissue is LAYERS else MESHES[mesh]
    displacement = bent_and_noisy(trunk)
    reference = REFERENCES[energy](trunk, tissue, gravity)
    state = state_of(trunk, tissue, displacement, energy=energy, gravity=gravity, precision=precision)
    found, inverted, newly_inverted = state.read()
    wanted = reference.energies(displacement)
    assert {name for name, value in found.terms.items() if value} <= wanted.keys()
    for term, value in wanted.items():
        assert found.terms.get(term, 0.0) == pytest.approx(value, rel=bound, abs=0.0), term
    assert found.total == pytest.approx(sum(wanted.values()), rel=bound)
    p = (trunk.nodes + displacement)[trunk.tets]
    turned = np.linalg.det(p[:, 1:] - p[:, :1]) <= 0.0
    assert (inverted, newly_inverted) == (turned.sum(), turned.sum())
    assert mesh == "one tetrahedron" or 0 < turned.sum() < len(trunk.tets)


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize(
    ("energy", "tissue"), [("itmsm", TISSUES["all terms"]), ("neo-hookean", LAYERS[0]), ("neo-hookean", LAYERS)]
)
def test_gradient_of_all_nodes(energy: str, tissue: Any, threads: int) -> None:
    """The sum of the ranges' parts is the gradient of the NumPy energy, prescribed nodes included."""
    trunk = half_and_half(MESHES["bone inside"]) if tissue is LAYERS else MESHES["bone inside"]
    displacement = bent_and_noisy(trunk)
    found = gradient_of(state_of(trunk, tissue, displacement, threads=threads, energy=energy, gravity=9.81))
    wanted = REFERENCES[energy](trunk, tissue, 9.81).gradient(displacement)
    np.testing.assert_allclose(found, wanted, rtol=1e-11, atol=1e-11 * np.abs(wanted).max())


@each_energy
def test_the_reference_gradient_is_that_of_the_reference_energy(energy: str) -> None:
    trunk, tissue = (
        (half_and_half(block()), LAYERS) if energy == "neo-hookean" else (block(), TISSUES["all terms"])
    )
    reference, displacement = REFERENCES[energy](trunk, tissue, 9.81), bent_and_noisy(trunk)
    rng = np.random.default_rng(1)
    for _ in range(5):
        along = 1e-5 * rng.normal(size=displacement.shape)
        change = reference.energy(displacement + along) - reference.energy(displacement - along)
        assert change == pytest.approx(2.0 * float((reference.gradient(displacement) * along).sum()), rel=1e-7)


@each_energy
@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_no_force_and_no_torque_but_the_weight(energy: str, gravity: float) -> None:
    """The weight m g [N], for itmsm in units of k_D / 2 [J], and nothing that turns the trunk."""
    trunk, tissue = MESHES["block"], Tissue(density=1100.0, youngs_modulus=7.0)
    displacement, reference = bent_and_noisy(trunk), Reference(trunk)
    gradient = gradient_of(state_of(trunk, tissue, displacement, energy=energy, gravity=gravity))
    cubic_metres = reference.rest_volumes * 1e-9
    k_d = 5.0 * 7.0e3 * cubic_metres.sum() / len(reference.edges)
    weight = np.zeros_like(displacement)
    np.add.at(weight[:, 2], trunk.tets.ravel(), np.repeat(1100.0 * gravity * cubic_metres / 4.0, 4))
    if energy == "itmsm":
        weight *= 1e-3 / (0.5 * k_d)
    scale, points = np.abs(gradient).max(), trunk.nodes + displacement
    np.testing.assert_allclose((gradient - weight).sum(axis=0), 0.0, atol=1e-11 * scale)
    np.testing.assert_allclose(np.cross(points, gradient - weight).sum(axis=0), 0.0, atol=1e-9 * scale)


@pytest.mark.parametrize("factor", [1e-3, 1e3])
@pytest.mark.parametrize(
    ("energy", "terms", "power"),
    [("itmsm", ("distance", "area", "volume"), 0), ("neo-hookean", ("shape", "volume"), 3)],
)
def test_terms_grow_with_the_volume_or_not_at_all(
    energy: str, terms: tuple[str, ...], power: int, factor: float
) -> None:
    trunk = MESHES["block"]
    displacement = bent_and_noisy(trunk)
    scaled = TrunkMesh(**{**trunk.__dict__, "nodes": factor * trunk.nodes})
    for precision, bound in (("float64", 1e-11), ("float32", 1e-5)):
        here, there = (
            state_of(mesh, None, size * displacement, energy=energy, precision=precision).energy().terms
            for mesh, size in ((trunk, 1.0), (scaled, factor))
        )
        for term in terms:
            assert there[term] == pytest.approx(factor**power * here[term], rel=bound)


@each_energy
@pytest.mark.parametrize(("precision", "rounding"), [("float32", 1e-4), ("float64", 1e-13)])
def test_rigid_motions_cost_nothing(energy: str, precision: str, rounding: float) -> None:
    trunk = MESHES["block"]
    moved = trunk.nodes @ rotation(70.0, (1.0, -1.0, 3.0)).T + np.array([200.0, -50.0, 900.0])
    turned, rest = (
        state_of(trunk, None, displacement, energy=energy, precision=precision)
        for displacement in (moved - trunk.nodes, np.zeros_like(moved))
    )
    springs = len(trunk.tets) * rounding**2 * 100.0  # a sum of squares; the other cancels 1e-2 mJ/mm^3
    bound = springs if energy == "itmsm" else 1e-5 * rounding * Reference(trunk).rest_volumes.sum()
    assert abs(turned.energy().total) < bound
    assert rest.energy().total == 0.0
    assert (rest.gradient.numpy() == 0.0).all()
