"""The neo-Hookean energy of a whole trunk against NumPy and closed forms, and its equilibria against SciPy's."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from support.continuum import Continuum, parts
from support.meshes import block, block_with_bone, rotation, trunk
from support.models import bent_and_noisy, evaluated, gradient_of, half_and_half, held_turned, model_of, relax
from warp_trunk.engine.energies.neo_hookean import stable_moduli
from warp_trunk.engine.model import Model
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh

LAYERS = (
    Tissue(youngs_modulus=10.0, poisson_ratio=0.4, density=900.0),
    Tissue(youngs_modulus=60.0, poisson_ratio=0.49, density=1200.0),
)


def continuum(mesh: TrunkMesh, tissue: Tissue | tuple[Tissue, ...], **options: Any) -> Model:
    return model_of(mesh, tissue, energy="neo-hookean", **options)


@pytest.mark.parametrize(
    ("precision", "gravity", "tissue"),
    [
        ("float64", 0.0, LAYERS[0]),
        ("float64", 9.81, LAYERS[0]),
        ("float64", 9.81, LAYERS),
        ("float32", 0.0, LAYERS[0]),
    ],
)
def test_energies_and_gradient_are_those_of_numpy(
    precision: str, gravity: float, tissue: Tissue | tuple[Tissue, ...]
) -> None:
    mesh = half_and_half(block_with_bone()) if isinstance(tissue, tuple) else block_with_bone()
    displacement = bent_and_noisy(mesh)
    state = evaluated(continuum(mesh, tissue, gravity=gravity, precision=precision), displacement)
    energy, inverted, _ = state.read()
    reference = Continuum(mesh, tissue, gravity)
    bound = {"float32": 3e-6, "float64": 1e-12}[precision]
    for term, value in reference.energies(displacement).items():
        assert energy.terms.get(term, 0.0) == pytest.approx(value, rel=bound, abs=0.0), term
    assert not {"distance", "area"} & energy.terms.keys()
    assert inverted == (np.linalg.det(reference.deformation(displacement)) <= 0.0).sum() > 0
    wanted = reference.gradient(displacement)
    np.testing.assert_allclose(gradient_of(state), wanted, atol=bound * np.abs(wanted).max())


def test_no_force_and_no_torque_but_the_weight() -> None:
    """The weight in newtons, m g, and nothing that turns the trunk."""
    mesh = block()
    tissue = Tissue(density=1100.0)
    displacement = bent_and_noisy(mesh)
    reference = Continuum(mesh, tissue, 9.81)
    gradient = gradient_of(evaluated(continuum(mesh, tissue, gravity=9.81), displacement))
    newtons = 9.81 * 1100.0 * reference.rest_volumes.sum() * 1e-9
    np.testing.assert_allclose(gradient.sum(axis=0), [0.0, 0.0, newtons], atol=1e-12)
    gradient[:, 2] -= reference.node_weight
    scale = np.abs(gradient).max()
    torque = np.cross(mesh.nodes + displacement, gradient).sum(axis=0)
    np.testing.assert_allclose(torque, 0.0, atol=1e-10 * scale)


def test_rigid_motions_cost_nothing() -> None:
    mesh = block()
    moved = mesh.nodes @ rotation(70.0, (1.0, -1.0, 3.0)).T + np.array([200.0, -50.0, 900.0])
    model = continuum(mesh, Tissue(), precision="float32")
    volume = Continuum(mesh).rest_volumes.sum()
    assert abs(evaluated(model, moved - mesh.nodes).energy().total) < 1e-9 * volume  # of some 1e-2 mJ/mm^3
    rest = evaluated(model, np.zeros_like(moved))
    assert rest.energy().total == 0.0
    assert (rest.gradient.numpy() == 0.0).all()


def test_energy_grows_as_the_volume() -> None:
    mesh = block()
    displacement = bent_and_noisy(mesh)
    scaled = replace(mesh, nodes=1e3 * mesh.nodes)
    here, there = (
        evaluated(continuum(one, Tissue(), precision="float32"), size * displacement).energy()
        for one, size in ((mesh, 1.0), (scaled, 1e3))
    )
    assert there.terms["shape"] == pytest.approx(1e9 * here.terms["shape"], rel=1e-5)
    assert there.terms["volume"] == pytest.approx(1e9 * here.terms["volume"], rel=1e-5)


@pytest.mark.parametrize("pull", [0.7, 1.001, 1.5])
@pytest.mark.parametrize("ratio", [0.3, 0.49])
def test_a_bar_pulled_with_free_sides(pull: float, ratio: float) -> None:
    """Its lateral stretch b makes the energy least, and the force on its end is dpsi/da times the area.

    The ends are placed where the closed form puts them; everything between finds its own place.
    """
    mesh = block((2, 2, 3), jitter=0.0)
    inside = (mesh.nodes[:, 2] > 0.0) & (mesh.nodes[:, 2] < 30.0)
    core = (np.abs(mesh.nodes[:, :2] - 10.0) < 10.0).all(axis=1)  # nodes of the sides stay on them
    noise = 2.0 * np.random.default_rng(4).uniform(-1.0, 1.0, mesh.nodes.shape)
    nodes = mesh.nodes + noise * np.column_stack([inside & core, inside & core, inside])
    bar = trunk(nodes, mesh.tets, ~inside)
    tissue = Tissue(youngs_modulus=12.0, poisson_ratio=ratio)
    mu, bulk = stable_moduli(tissue)

    def psi(a: float, b: float) -> float:
        return float(sum(parts(np.diag([b, b, a]), mu, bulk)))

    def across(b: float) -> float:
        return mu * (1.0 - 1.0 / (pull**2 + 2.0 * b**2 + 1.0)) + (bulk * (pull * b**2 - 1.0) - 0.75 * mu) * pull

    b = float(brentq(across, 0.3, 2.0, xtol=1e-14))  # pyright: ignore[reportArgumentType]
    wanted = nodes * [b, b, pull] - nodes
    model = continuum(bar, tissue)
    relaxation, found = relax(model, np.where(inside[:, None], 0.0, wanted), tolerance=1e-7)
    assert relaxation.status is RelaxStatus.CONVERGED
    np.testing.assert_allclose(found, wanted, atol=1e-7)
    top = nodes[:, 2] == 30.0
    force = gradient_of(evaluated(model, wanted))[top].sum(axis=0)
    slope = (psi(pull + 1e-5, b) - psi(pull - 1e-5, b)) / 2e-5
    np.testing.assert_allclose(force, [0.0, 0.0, 400.0 * slope], atol=1e-7 * abs(400.0 * slope) + 1e-9)
    if pull == 1.001:  # small strains: E and nu
        assert slope / 0.001 == pytest.approx(12e-3, rel=3e-3)
        assert (1.0 - b) / 0.001 == pytest.approx(ratio, rel=3e-3)


@pytest.mark.parametrize("gravity", [0.0, 9.81])
@pytest.mark.parametrize("tissue", [Tissue(poisson_ratio=0.49), LAYERS])
def test_same_equilibrium_as_scipy(tissue: Tissue | tuple[Tissue, ...], gravity: float) -> None:
    mesh = block((2, 2, 3))
    mesh = half_and_half(mesh) if isinstance(tissue, tuple) else mesh
    start = held_turned(mesh, 20.0, [4.0, -2.0, 3.0])
    relaxation, found = relax(continuum(mesh, tissue, gravity=gravity), start, tolerance=1e-7)
    assert relaxation.status is RelaxStatus.CONVERGED
    reference = Continuum(mesh, tissue, gravity)
    wanted = reference.equilibrium(start)
    assert relaxation.energy.total == pytest.approx(reference.energy(wanted), rel=1e-9)
    np.testing.assert_allclose(found, wanted, atol=2e-7)
