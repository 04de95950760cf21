"""State's energies against eq. 4.6 of [2] summed over unique edges, unique faces and tetrahedra in NumPy."""

from typing import Any

import numpy as np
import pytest

from support.meshes import block, block_with_bone, rotation, single_tet
from support.reference import Reference
from support.threads import split_launches
from warp_trunk.engine.build import build_model
from warp_trunk.engine.energies.itmsm import Itmsm
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


def random_displacement(trunk: TrunkMesh) -> np.ndarray:
    """A stretch and turn of some millimetres, and noise that inverts a few tetrahedra."""
    rng = np.random.default_rng(8)
    bend = trunk.nodes @ (1.1 * rotation(25.0, (1.0, 2.0, 0.5))).T - trunk.nodes
    return bend + rng.normal(scale=2.5, size=bend.shape)


def evaluated(trunk: TrunkMesh, displacement: np.ndarray, threads: int = 2, **options: Any) -> State:
    state = State(
        build_model(trunk, device=split_launches(threads), **{"energy": "itmsm", "skin_rigidity": 0.0, **options})
    )
    state.set_displacement(displacement)
    state.evaluate()
    return state


@pytest.mark.parametrize("gravity", [0.0, 9.81])
@pytest.mark.parametrize(("precision", "bound"), [("float32", 1e-6), ("float64", 1e-12)])
@pytest.mark.parametrize("tissue", TISSUES)
@pytest.mark.parametrize("mesh", MESHES)
def test_energies_by_term(mesh: str, tissue: str, precision: str, bound: float, gravity: float) -> None:
    trunk = MESHES[mesh]
    displacement = random_displacement(trunk)
    state = evaluated(trunk, displacement, tissue=TISSUES[tissue], gravity=gravity, precision=precision)
    found = state.energy()
    wanted = Reference(trunk, TISSUES[tissue], gravity).energies(displacement)
    for term, value in wanted.items():
        assert found.terms.get(term, 0.0) == pytest.approx(value, rel=bound, abs=0.0), term
    assert found.total == pytest.approx(sum(wanted.values()), rel=bound)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_counts_inverted_tetrahedra(precision: str) -> None:
    trunk = MESHES["block"]
    displacement = random_displacement(trunk)
    points = trunk.nodes + displacement
    p = points[trunk.tets]
    turned = np.einsum("ij,ij->i", np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), p[:, 3] - p[:, 0]) <= 0.0
    assert 0 < turned.sum() < len(trunk.tets)
    state = evaluated(trunk, displacement, precision=precision)
    _, inverted, newly_inverted = state.read()
    assert (inverted, newly_inverted) == (turned.sum(), turned.sum())


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_gradient_of_all_nodes(threads: int) -> None:
    """The sum of the ranges' parts is the gradient of the NumPy energy, prescribed nodes included."""
    trunk, tissue = MESHES["bone inside"], TISSUES["all terms"]
    displacement = random_displacement(trunk)
    state = evaluated(trunk, displacement, tissue=tissue, gravity=9.81, precision="float64", threads=threads)
    found = np.empty_like(trunk.nodes)
    found[state.model.order] = state.gradient.numpy()
    wanted = Reference(trunk, tissue, 9.81).gradient(displacement)
    np.testing.assert_allclose(found, wanted, rtol=1e-11, atol=1e-11 * np.abs(wanted).max())


def test_the_reference_gradient_is_that_of_the_reference_energy() -> None:
    trunk = MESHES["block"]
    reference = Reference(trunk, TISSUES["all terms"], 9.81)
    rng = np.random.default_rng(1)
    displacement = random_displacement(trunk)
    for _ in range(5):
        along = rng.normal(size=displacement.shape)
        step = 1e-5
        change = (
            reference.energy(displacement + step * along) - reference.energy(displacement - step * along)
        ) / (2.0 * step)
        assert change == pytest.approx(float((reference.gradient(displacement) * along).sum()), rel=1e-7)


def test_no_force_and_no_torque_but_the_weight() -> None:
    """alpha M_total / (M_0 H_0) for each mm, and nothing that turns the trunk."""
    trunk, tissue = MESHES["block"], TISSUES["all terms"]
    displacement = random_displacement(trunk)
    for gravity in (0.0, 9.81):
        state = evaluated(trunk, displacement, tissue=tissue, gravity=gravity, precision="float64")
        elements, gradient = state.model.elements, state.gradient.numpy()
        assert isinstance(elements, Itmsm)
        points = (trunk.nodes + displacement)[state.model.order]
        weight = np.zeros_like(gradient)
        if gravity:
            volume = Reference(trunk).rest_volumes
            mean_mass, total_mass = tissue.density * volume.mean(), tissue.density * volume.sum()
            height = np.ptp(trunk.nodes[:, 2])
            quarter = np.zeros(len(points))
            np.add.at(quarter, state.model.corners.ravel(), 0.25)
            assert gradient[:, 2].sum() == pytest.approx(
                elements.alpha * total_mass / (mean_mass * height), rel=1e-10
            )
            masses = np.zeros(len(trunk.nodes))
            np.add.at(masses, trunk.tets.ravel(), np.repeat(tissue.density * volume / 4.0, 4))
            weight[:, 2] = elements.alpha * masses[state.model.order] / (mean_mass * height)
        scale = np.abs(gradient).max()
        np.testing.assert_allclose((gradient - weight).sum(axis=0), 0.0, atol=1e-11 * scale)
        np.testing.assert_allclose(np.cross(points, gradient - weight).sum(axis=0), 0.0, atol=1e-9 * scale)


def test_weight_in_newtons() -> None:
    """k_D / 2 [J] times the gradient along z is the tissue's weight m g [N]."""
    trunk = MESHES["block"]
    tissue = Tissue(density=1100.0, youngs_modulus=7.0)
    state = evaluated(trunk, np.zeros_like(trunk.nodes), tissue=tissue, gravity=9.81, precision="float64")
    reference = Reference(trunk)
    cubic_metres = reference.rest_volumes.sum() * 1e-9
    k_d = 5.0 * 7.0e3 * cubic_metres / len(reference.edges)
    per_metre = state.gradient.numpy()[:, 2].sum() * 1e3
    assert 0.5 * k_d * per_metre == pytest.approx(1100.0 * cubic_metres * 9.81, rel=1e-9)


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_relative_terms_do_not_know_the_scale(factor: float) -> None:
    trunk = MESHES["block"]
    displacement = random_displacement(trunk)
    scaled = TrunkMesh(**{**trunk.__dict__, "nodes": factor * trunk.nodes})
    for precision, bound in (("float64", 1e-12), ("float32", 1e-5)):
        here = evaluated(trunk, displacement, precision=precision).energy()
        there = evaluated(scaled, factor * displacement, precision=precision).energy()
        for term in ("distance", "area", "volume"):
            assert there.terms[term] == pytest.approx(here.terms[term], rel=bound)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_rigid_motions_cost_nothing(precision: str) -> None:
    trunk = MESHES["block"]
    moved = trunk.nodes @ rotation(70.0, (1.0, -1.0, 3.0)).T + np.array([200.0, -50.0, 900.0])
    energy = evaluated(trunk, moved - trunk.nodes, precision=precision).energy()
    rounding = {"float32": 1e-4, "float64": 1e-13}[precision]
    assert energy.total < len(trunk.tets) * rounding**2 * 100.0
    assert evaluated(trunk, np.zeros_like(moved), precision=precision).energy().total == 0.0
