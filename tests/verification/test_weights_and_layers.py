"""The energy itmsm with weights by volume, and of several tissues, against sums over tetrahedra in NumPy."""

from collections import Counter
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest

from support.meshes import block, grid, rotation, trunk
from support.models import evaluated, half_and_half, model_of
from support.reference import Reference, volumes
from warp_trunk.engine.relaxation import Energy
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.errors import InputError

SOFT = Tissue(epsilon=0.5, theta=8.0, youngs_modulus=5.0, density=900.0)
STIFF = Tissue(epsilon=2.0, theta=20.0, youngs_modulus=35.0, density=1300.0)


def energy_of(mesh: TrunkMesh, displacement: np.ndarray, tissue: Any, **options: Any) -> Energy:
    return evaluated(model_of(mesh, tissue, **options), displacement).energy()


def half_refined() -> TrunkMesh:
    """Two cubes of equal size; the upper one of cells of half the edge, not joined to the lower one."""
    coarse, tets, _ = grid((2, 2, 2), 10.0)
    fine, fine_tets, _ = grid((4, 4, 4), 5.0)
    nodes = np.vstack([coarse, fine + np.array([0.0, 0.0, 30.0])])
    held = (nodes[:, 2] == 0.0) | (nodes[:, 2] == 30.0)
    return trunk(nodes, np.vstack([tets, fine_tets + len(coarse)]), held)


@pytest.mark.parametrize(("weights", "upper_share"), [("volume", 0.5), ("count", None)])
def test_by_volume_equal_parts_of_tissue_are_equally_stiff(weights: str, upper_share: float | None) -> None:
    """Swelling one of the two cubes: fine cells cost more by count, the same by volume."""
    mesh = half_refined()
    upper = mesh.nodes[:, 2] >= 30.0
    swollen = 0.1 * (mesh.nodes - [10.0, 10.0, 30.0])
    one = energy_of(mesh, np.where(upper[:, None], swollen, 0.0), SOFT, weights=weights)
    other = energy_of(mesh, np.where(upper[:, None], 0.0, swollen), SOFT, weights=weights)
    for term in ("distance", "area", "volume"):
        share = one.terms[term] / (one.terms[term] + other.terms[term])
        assert share == pytest.approx(upper_share, rel=1e-12) if upper_share else share > 0.8, term


def test_by_volume_the_whole_trunk_is_as_stiff_as_by_count() -> None:
    """Where every feature is stretched alike, the energy is the number of features times its square."""
    mesh = block()
    swollen = 0.1 * mesh.nodes
    by_count, by_volume = (energy_of(mesh, swollen, SOFT, weights=weights) for weights in ("count", "volume"))
    for term in ("distance", "area", "volume"):
        assert by_volume.terms[term] == pytest.approx(by_count.terms[term], rel=1e-12)


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


def test_a_uniform_scene_uploads_no_constant_for_each_tetrahedron() -> None:
    mesh = block((2, 2, 2))
    labelled = replace(mesh, tissue=np.zeros(len(mesh.tets), dtype=np.int8))
    itmsm: Any = model_of(labelled, SOFT).elements
    continuum: Any = model_of(mesh, SOFT, energy="neo-hookean").elements
    assert len(itmsm.theta) == len(itmsm.gravity_weight) == len(continuum.moduli) == 1
    layers: Any = model_of(labelled, (SOFT, STIFF), energy="neo-hookean").elements
    assert len(layers.moduli) == len(mesh.tets)


@pytest.mark.parametrize(
    ("label", "tissue", "options", "text"),
    [
        (None, (), {}, "there is none"),
        (None, (SOFT, STIFF), {}, "does not say which"),
        (2, (SOFT, STIFF), {}, "labels from 0 to 2 but 2 tissues"),
        (-1, (SOFT, STIFF), {}, "labels from -1"),
        (None, SOFT, {"energy": "magic"}, "itmsm or neo-hookean"),
        (None, SOFT, {"weights": "mass"}, "count or volume"),
        (None, SOFT, {"weights": "volume", "energy": "neo-hookean"}, "leave it out"),
    ],
)
def test_refuses(label: int | None, tissue: Any, options: Any, text: str) -> None:
    mesh = block((2, 2, 2))
    if label is not None:
        mesh = replace(mesh, tissue=np.where(np.arange(len(mesh.tets)) == 3, label, 0).astype(np.int8))
    with pytest.raises(InputError, match=text) as caught:
        model_of(mesh, tissue, **options)
    assert "\n" not in str(caught.value)
