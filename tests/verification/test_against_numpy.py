"""Energies, gradients and equilibria against NumPy and SciPy, of tissues of one kind or more."""

from collections import Counter
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest

from support.continuum import Continuum
from support.meshes import block, block_with_bone, rotation, single_tet
from support.models import bent_and_noisy, evaluated, gradient_of, half_and_half, model_of
from support.reference import Reference, volumes
from warp_trunk.engine.relaxation import Energy
from warp_trunk.engine.state import State
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh

MESHES = {"bone inside": block_with_bone(), "one tetrahedron": single_tet()}
ALL_TERMS = Tissue(epsilon=0.7, theta=13.0, density=950.0, youngs_modulus=4.0)
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
        ("itmsm", "one tetrahedron", ALL_TERMS),
        ("itmsm", "bone inside", ALL_TERMS),
        ("itmsm", "bone inside", Tissue(epsilon=0.0, theta=0.0)),
        ("itmsm", "bone inside", Tissue(epsilon=0.0, theta=5.0)),
        ("itmsm", "bone inside", Tissue(epsilon=2.0, theta=0.0)),
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
    energies, inverted, newly_inverted = state.read()
    wanted = reference.energies(displacement)
    assert {name for name, value in energies.terms.items() if value} <= wanted.keys()
    for term, value in wanted.items():
        assert energies.terms.get(term, 0.0) == pytest.approx(value, rel=bound, abs=0.0), term
    assert energies.total == pytest.approx(sum(wanted.values()), rel=bound)
    p = (trunk.nodes + displacement)[trunk.tets]
    turned = np.linalg.det(p[:, 1:] - p[:, :1]) <= 0.0
    assert (inverted, newly_inverted) == (turned.sum(), turned.sum())
    assert mesh == "one tetrahedron" or 0 < turned.sum() < len(trunk.tets)


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize(
    ("energy", "tissue"), [("itmsm", ALL_TERMS), ("neo-hookean", LAYERS[0]), ("neo-hookean", LAYERS)]
)
def test_gradient_of_all_nodes(energy: str, tissue: Any, threads: int) -> None:
    """The sum of the ranges' parts is the gradient of the NumPy energy, prescribed nodes included."""
    trunk = half_and_half(MESHES["bone inside"]) if tissue is LAYERS else MESHES["bone inside"]
    displacement = bent_and_noisy(trunk)
    gradient = gradient_of(state_of(trunk, tissue, displacement, threads=threads, energy=energy, gravity=9.81))
    wanted = REFERENCES[energy](trunk, tissue, 9.81).gradient(displacement)
    np.testing.assert_allclose(gradient, wanted, rtol=1e-11, atol=1e-11 * np.abs(wanted).max())


@each_energy
def test_the_reference_gradient_is_that_of_the_reference_energy(energy: str) -> None:
    trunk, tissue = (half_and_half(block()), LAYERS) if energy == "neo-hookean" else (block(), ALL_TERMS)
    reference, displacement = REFERENCES[energy](trunk, tissue, 9.81), bent_and_noisy(trunk)
    along = 1e-5 * np.random.default_rng(1).normal(size=displacement.shape)
    change = reference.energy(displacement + along) - reference.energy(displacement - along)
    assert change == pytest.approx(2.0 * float((reference.gradient(displacement) * along).sum()), rel=1e-7)


SOFT = Tissue(epsilon=0.5, theta=8.0, youngs_modulus=5.0, density=900.0)
STIFF = Tissue(epsilon=2.0, theta=20.0, youngs_modulus=35.0, density=1300.0)


def energy_of(mesh: TrunkMesh, displacement: np.ndarray, tissue: Any, **options: Any) -> Energy:
    return evaluated(model_of(mesh, tissue, **options), displacement).energy()


def measure_of(points: np.ndarray, feature: tuple[int, ...]) -> float:
    """Length, area or volume."""
    edges = points[list(feature[1:])] - points[feature[0]]
    return float(np.sqrt(np.linalg.det(edges @ edges.T)))


def expected(
    mesh: TrunkMesh, displacement: np.ndarray, tissues: tuple[Tissue, ...], weights: str
) -> dict[str, float]:
    """Every tetrahedron's terms, with its own tissue's constants and its share of edges, faces and itself."""
    points, tets = mesh.nodes + displacement, mesh.tets.tolist()
    rest_volume = volumes(mesh.nodes, mesh.tets)
    sign = np.sign(volumes(points, mesh.tets))
    total: dict[str, float] = dict.fromkeys(("distance", "area", "volume"), 0.0)
    for size, term in enumerate(total, start=2):
        times = Counter(feature for tet in tets for feature in combinations(sorted(tet), size))
        for t, tet in enumerate(tets):
            tissue = tissues[0 if mesh.tissue is None else mesh.tissue[t]]
            factor = {"distance": 1.0, "area": tissue.epsilon, "volume": tissue.theta}[term]
            own = list(combinations(sorted(tet), size))
            for feature in own:
                grown = measure_of(points, feature) * (sign[t] if size == 4 else 1.0)
                by_volume = rest_volume[t] / rest_volume.sum() * len(times) / len(own)
                share = 1.0 / times[feature] if weights == "count" else by_volume
                change = grown / measure_of(mesh.nodes, feature) - 1.0
                total[term] += tissue.youngs_modulus / tissues[0].youngs_modulus * factor * share * change**2
    return total


@pytest.mark.parametrize("weights", ["count", "volume"])
@pytest.mark.parametrize("tissues", [(SOFT,), (SOFT, STIFF), (STIFF, replace(SOFT, epsilon=0.0))])
def test_energies_of_tissues(tissues: tuple[Tissue, ...], weights: str) -> None:
    mesh = block((2, 2, 2))
    if len(tissues) > 1:
        mesh = replace(mesh, tissue=np.random.default_rng(3).integers(0, 2, len(mesh.tets)).astype(np.int8))
    rng = np.random.default_rng(8)
    displacement = mesh.nodes @ (1.1 * rotation(25.0)).T - mesh.nodes + rng.normal(size=mesh.nodes.shape)
    energy = energy_of(mesh, displacement, tissues, weights=weights)
    for term, value in expected(mesh, displacement, tissues, weights).items():
        assert energy.terms.get(term, 0.0) == pytest.approx(value, rel=1e-12), term


def test_weight_of_tissues_in_newtons() -> None:
    """k_D / 2 [J] times the gradient along z is m g, with k_D of the first tissue."""
    mesh = half_and_half(block((2, 2, 2)))
    state = evaluated(model_of(mesh, (SOFT, STIFF), gravity=9.81), np.zeros_like(mesh.nodes))
    volume = volumes(mesh.nodes, mesh.tets) * 1e-9
    k_d = 5.0 * 5e3 * volume.sum() / len(Reference(mesh).edges)
    newtons = 0.5 * k_d * state.gradient.numpy().sum(axis=0)[2] * 1e3
    assert newtons == pytest.approx(9.81 * (900.0 * volume[::2].sum() + 1300.0 * volume[1::2].sum()), rel=1e-10)
