"""scikit-fem and warp_trunk against equilibria that are known exactly, against each other, and by differences.

Exact equilibria of the stable neo-Hookean energy are worked out by hand from its stress. Lengths are in mm, the
modulus is 1 kPa: without gravity no displacement depends on it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import root_scalar

from support.continuum import stable
from support.finite_elements import Solid, equilibrium
from support.meshes import block, block_with_bone, grid, rotate, rotation, trunk, turned_about_z
from support.models import evaluated, gradient_of, model_of, relax
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh

MODULUS, DENSITY = 1.0, 1000.0
"""Young's modulus [kPa] and [kg/m^3]."""
Held = Callable[[np.ndarray], np.ndarray]
"""Which nodes are on bone."""


def constants(nu: float) -> tuple[float, float, float]:
    """mu, lambda and alpha of Smith, de Goes and Kim (2018), section 3.4, for the modulus and a Poisson ratio."""
    mu, lam = stable(MODULUS, nu)
    return mu, lam, 1.0 + mu / lam - mu / (4.0 * lam)


def brick(held: Held) -> TrunkMesh:
    """An irregular cube of 30 mm whose lowest corner is (10, 20, 10)."""
    nodes, tets, _ = grid((3, 3, 3), 10.0)
    noise = np.random.default_rng(2).uniform(-1.5, 1.5, nodes.shape)
    moved = nodes + np.where(all_around(nodes)[:, None], 0.0, noise)
    return trunk(moved + np.array([10.0, 20.0, 10.0]), tets, held(nodes))


def all_around(nodes: np.ndarray) -> np.ndarray:
    return np.any((nodes < 1e-9) | (nodes > 30.0 - 1e-9), axis=1)


def the_ends(nodes: np.ndarray) -> np.ndarray:
    return (nodes[:, 2] < 1e-9) | (nodes[:, 2] > 30.0 - 1e-9)


def pulled(stretch: float, nu: float) -> tuple[np.ndarray, float]:
    """F of a bar pulled along z with free sides, where P_xx = 0, and its nominal stress [kPa]."""
    mu, lam, alpha = constants(nu)

    def stresses(across: float) -> tuple[float, float]:
        squares = stretch**2 + 2.0 * across**2
        shear, pressure = mu * (1.0 - 1.0 / (squares + 1.0)), lam * (stretch * across**2 - alpha)
        return shear * across + pressure * stretch * across, shear * stretch + pressure * across**2

    across = root_scalar(lambda across: stresses(across)[0], bracket=(0.5, 2.0), xtol=1e-15).root
    return np.diag([across, across, stretch]), stresses(across)[1]


def sheared(amount: float, nu: float) -> tuple[np.ndarray, np.ndarray, float]:
    """F of simple shear, its nominal stress [kPa] and its energy per volume; J = 1, I_C = 3 + amount^2."""
    mu, lam, alpha = constants(nu)
    squares = 3.0 + amount**2
    shear, pressure = mu * (1.0 - 1.0 / (squares + 1.0)), lam * (1.0 - alpha)
    P = (shear + pressure) * np.eye(3)
    P[0, 1] = shear * amount
    P[1, 0] = -pressure * amount
    energy = 0.5 * mu * (amount**2 - np.log1p(amount**2 / 4.0))
    F = np.eye(3)
    F[0, 1] = amount
    return F, P, energy


@dataclass(frozen=True)
class Solution:
    """Where a solver ended."""

    displacement: np.ndarray
    """Of all nodes [mm], shape (nodes, 3)."""
    energy: float
    """Elastic, less the work of the weight from rest [mJ]."""
    forces: np.ndarray
    """That hold the nodes [N], shape (nodes, 3)."""


def by_scikit_fem(trunk: TrunkMesh, start: np.ndarray, nu: float, gravity: float = 0.0) -> Solution:
    solid = Solid(trunk.nodes, trunk.tets, 1e-3 * MODULUS, nu, 1e-9 * DENSITY * gravity)
    displacement = equilibrium(solid, start, trunk.prescribed)
    return Solution(displacement, solid.energy(displacement), solid.forces(displacement))


def by_warp_trunk(trunk: TrunkMesh, start: np.ndarray, nu: float, gravity: float = 0.0) -> Solution:
    tissue = Tissue(youngs_modulus=MODULUS, poisson_ratio=nu, density=DENSITY)
    model = model_of(trunk, tissue, threads=1, energy="neo-hookean", gravity=gravity)
    relaxation, displacement = relax(model, start, tolerance=1e-9)
    assert relaxation.status is RelaxStatus.CONVERGED, relaxation
    state = evaluated(model, displacement)
    return Solution(displacement, state.energy().total - model.elements.gravity_at_rest, gradient_of(state))


SOLVERS = {"scikit-fem": by_scikit_fem, "warp_trunk": by_warp_trunk}


def check_affine(solver: str, held: Held, F: np.ndarray, nu: float) -> tuple[TrunkMesh, Solution]:
    """F everywhere, which is an equilibrium where all around or no stress acts, is where a noisy start ends."""
    mesh = brick(held)
    exact = mesh.nodes @ (F - np.eye(3)).T
    noise = np.random.default_rng(4).uniform(-0.3, 0.3, exact.shape) * ~mesh.prescribed[:, None]
    solved = SOLVERS[solver](mesh, exact + noise, nu)
    assert np.linalg.norm(solved.displacement - exact, axis=1).max() < 1e-7
    return mesh, solved


def area_vectors(mesh: TrunkMesh) -> np.ndarray:
    """For every node a third of the outward area vectors of the boundary triangles around it [mm^2] (nodes, 3)."""
    vectors = np.zeros_like(mesh.nodes)
    for corners in ([1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]):  # outward; inside the two sides cancel
        a, b, c = (mesh.nodes[mesh.tets[:, corner]] for corner in corners)
        for corner in corners:
            np.add.at(vectors, mesh.tets[:, corner], np.cross(b - a, c - a) / 6.0)
    return vectors


@pytest.mark.parametrize("solver", SOLVERS)
def test_patch_and_rigid_motion(solver: str) -> None:
    """Nodes all around carried by one affine map carry those inside with them, and a turn costs nothing."""
    stretch = np.array([[1.2, 0.1, -0.2], [0.05, 0.85, 0.1], [0.0, -0.15, 1.1]])
    check_affine(solver, all_around, rotation(50.0, (1.0, 2.0, 3.0)) @ stretch, 0.49)
    _, solved = check_affine(solver, the_ends, rotation(120.0, (1.0, -2.0, 0.5)), 0.45)
    assert abs(solved.energy) < 1e-12
    assert np.abs(solved.forces).max() < 1e-9


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(("stretch", "nu"), [(0.7, 0.49), (1.5, 0.3)])
def test_pulled_and_pressed(solver: str, stretch: float, nu: float) -> None:
    F, stress = pulled(stretch, nu)
    mesh, solved = check_affine(solver, the_ends, F, nu)
    force = solved.forces[mesh.nodes[:, 2] > 39.9].sum(axis=0)
    np.testing.assert_allclose(force / 900.0, [0.0, 0.0, 1e-3 * stress], atol=1e-9)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("nu", [0.3, 0.49])
def test_simple_shear(solver: str, nu: float) -> None:
    """Energy of the whole and the force on every node all around, P times its area vector."""
    F, stress, energy = sheared(0.7, nu)
    mesh, solved = check_affine(solver, all_around, F, nu)
    assert solved.energy == pytest.approx(1e-3 * energy * 27000.0, rel=1e-9)
    np.testing.assert_allclose(solved.forces, 1e-3 * area_vectors(mesh) @ stress.T, atol=1e-9)


def moved_bone() -> tuple[TrunkMesh, np.ndarray]:
    """One bone is held; the other moves by two thirds of an edge and turns."""
    trunk = block_with_bone((5, 4, 4), holes=((0, 1, 1), (3, 2, 2)))
    start = np.zeros_like(trunk.nodes)
    moving = trunk.bone == 1
    start[moving] = rotate(trunk.nodes[moving], 25.0, (1.0, 1.0, 0.0)) - trunk.nodes[moving]
    start[moving] += [2.0, 5.0, -3.0]
    return trunk, start


def turned_end() -> tuple[TrunkMesh, np.ndarray]:
    """A column whose top is turned by 90 degrees against its foot; the start winds it."""
    trunk = block((3, 3, 6))
    z = trunk.nodes[:, 2]
    trunk.bone[z > 57.0] = 0
    degrees = 90.0 * np.where(trunk.prescribed, z > 30.0, np.clip(z / 60.0, 0.0, 1.0))
    return trunk, turned_about_z(trunk.nodes, degrees, (15.0, 15.0)) - trunk.nodes


@pytest.mark.slow
@pytest.mark.parametrize("gravity", [0.0, 9.81])
@pytest.mark.parametrize("nu", [0.3, 0.49])
@pytest.mark.parametrize("scene", [moved_bone, turned_end])
def test_same_equilibrium(scene: Callable[[], tuple[TrunkMesh, np.ndarray]], nu: float, gravity: float) -> None:
    """Every node to 1e-6 mm, the energy and the forces that hold the bones to nine digits."""
    trunk, start = scene()
    wanted, solved = (SOLVERS[name](trunk, start, nu, gravity) for name in ("scikit-fem", "warp_trunk"))
    assert np.linalg.norm(wanted.displacement - start, axis=1).max() > 1.0
    assert np.linalg.norm(solved.displacement - wanted.displacement, axis=1).max() < 1e-6
    assert solved.energy == pytest.approx(wanted.energy, rel=1e-9)
    np.testing.assert_allclose(solved.forces, wanted.forces, atol=1e-8 * np.abs(wanted.forces).max())
