"""scikit-fem and warp_trunk against equilibria that are known exactly, against each other, and by differences.

Exact equilibria of the stable neo-Hookean energy are worked out by hand from its stress. Lengths are in mm, the
modulus is 1 kPa: without gravity no displacement depends on it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import root_scalar
from skfem import Basis, ElementTetP1

from support.continuum import stable
from support.finite_elements import Solid, equilibrium, tangent, tet_mesh
from support.meshes import block, block_with_bone, grid, rotate, rotation, trunk, turned_about_z
from support.models import evaluated, gradient_of, model_of, relax
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh

MODULUS = 1.0
"""Young's modulus [kPa]."""
DENSITY, GRAVITY = 1000.0, 10.0
"""[kg/m^3] and [m/s^2], where there is gravity."""
WEIGHT = 1e-6 * DENSITY * GRAVITY
"""Their product [kPa/mm]."""


@dataclass(frozen=True)
class Exact:
    """A trunk with a known equilibrium."""

    trunk: TrunkMesh
    """Its prescribed nodes are held where the solution has them."""
    displacement: Callable[[np.ndarray], np.ndarray]
    """Of points at rest (n, 3), shape (n, 3)."""
    gravity: float = 0.0
    """Pulling down [m/s^2]."""

    def start(self) -> np.ndarray:
        """Prescribed nodes at their place, the others by the nearest affine map and 0.3 mm of noise (nodes, 3)."""
        held, points = self.trunk.prescribed, np.column_stack([self.trunk.nodes, np.ones(len(self.trunk.nodes))])
        exact = self.displacement(self.trunk.nodes)
        affine_map = np.linalg.lstsq(points[held], exact[held], rcond=None)[0]
        noise = np.random.default_rng(4).uniform(-0.3, 0.3, exact.shape)
        return np.where(held[:, None], exact, points @ affine_map + noise)


def constants(nu: float) -> tuple[float, float, float]:
    """mu, lambda and alpha of Smith, de Goes and Kim (2018), section 3.4, for the modulus and a Poisson ratio."""
    mu, lam = stable(MODULUS, nu)
    return mu, lam, 1.0 + mu / lam - mu / (4.0 * lam)


def brick(cells: int, held: Callable[[np.ndarray], np.ndarray], jitter: float = 0.0) -> TrunkMesh:
    """A cube of 30 mm whose lowest corner is (10, 20, 10); inner nodes moved by `jitter` spacings."""
    nodes, tets, _ = grid((cells, cells, cells), 30.0 / cells)
    on_boundary = all_around(nodes)
    noise = np.random.default_rng(2).uniform(-1.0, 1.0, nodes.shape) * (30.0 / cells)
    nodes = nodes + jitter * np.where(on_boundary[:, None], 0.0, noise)
    return trunk(nodes + np.array([10.0, 20.0, 10.0]), tets, held(nodes))


def all_around(nodes: np.ndarray) -> np.ndarray:
    return np.any((nodes < 1e-9) | (nodes > 30.0 - 1e-9), axis=1)


def the_ends(nodes: np.ndarray) -> np.ndarray:
    return (nodes[:, 2] < 1e-9) | (nodes[:, 2] > 30.0 - 1e-9)


def all_but_the_top(nodes: np.ndarray) -> np.ndarray:
    return (nodes[:, 2] < 1e-9) | all_around(nodes[:, :2])


def affine(trunk: TrunkMesh, F: np.ndarray) -> Exact:
    """The same deformation gradient everywhere, which is an equilibrium where all around or no stress acts."""
    return Exact(trunk, lambda X: X @ (F - np.eye(3)).T)


def pulled(stretch: float, nu: float) -> tuple[Exact, float]:
    """A bar pulled along z with free sides, and its nominal stress [kPa]: P_xx = 0 gives the stretch across."""
    mu, lam, alpha = constants(nu)

    def stresses(across: float) -> tuple[float, float]:
        squares = stretch**2 + 2.0 * across**2
        shear, pressure = mu * (1.0 - 1.0 / (squares + 1.0)), lam * (stretch * across**2 - alpha)
        return shear * across + pressure * stretch * across, shear * stretch + pressure * across**2

    across = root_scalar(lambda across: stresses(across)[0], bracket=(0.5, 2.0), xtol=1e-15).root
    return affine(brick(3, the_ends, 0.15), np.diag([across, across, stretch])), stresses(across)[1]


def sheared(amount: float, nu: float) -> tuple[Exact, np.ndarray, float]:
    """Simple shear x += amount y, its nominal stress [kPa], its energy per volume; J = 1, I_C = 3 + amount^2."""
    mu, lam, alpha = constants(nu)
    squares = 3.0 + amount**2
    shear, pressure = mu * (1.0 - 1.0 / (squares + 1.0)), lam * (1.0 - alpha)
    P = (shear + pressure) * np.eye(3)
    P[0, 1] = shear * amount
    P[1, 0] = -pressure * amount
    energy = 0.5 * mu * (amount**2 - np.log1p(amount**2 / 4.0))
    F = np.eye(3)
    F[0, 1] = amount
    return affine(brick(3, all_around, 0.15), F), P, energy


def hanging(cells: int, nu: float) -> Exact:
    """A column that can move only along z and bears its own weight: P_zz = -weight times the height above.

    With the stretch s along z, P_zz = mu (1 - 1 / (s^2 + 3)) s + lambda (s - alpha) gives s at each height, and
    the displacement is its integral from the ground, by Gauss points.
    """
    mu, lam, alpha = constants(nu)
    ground, top = 10.0, 40.0
    z = np.linspace(ground, top, 301)
    points, weights = np.polynomial.legendre.leggauss(4)
    half = 0.5 * (z[1] - z[0])

    def stretch(height: float) -> float:
        def excess(s: float) -> float:
            return mu * (1.0 - 1.0 / (s**2 + 3.0)) * s + lam * (s - alpha) + WEIGHT * (top - height)

        return root_scalar(excess, bracket=(0.05, 1.5), xtol=1e-14).root

    inside = [[stretch(low + half * (1.0 + x)) - 1.0 for x in points] for low in z[:-1]]
    sinking = np.concatenate([[0.0], np.cumsum(half * np.array(inside) @ weights)])
    curve = CubicHermiteSpline(z, sinking, [stretch(height) - 1.0 for height in z])
    return Exact(
        brick(cells, all_but_the_top), lambda X: np.column_stack([np.zeros((len(X), 2)), curve(X[:, 2])]), GRAVITY
    )


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


def solve(solver: str, exact: Exact, nu: float) -> Solution:
    return SOLVERS[solver](exact.trunk, exact.start(), nu, exact.gravity)


def farthest(exact: Exact, displacement: np.ndarray) -> float:
    """Largest distance of a node from the exact solution [mm]."""
    return float(np.linalg.norm(displacement - exact.displacement(exact.trunk.nodes), axis=1).max())


def area_vectors(exact: Exact) -> np.ndarray:
    """For every node a third of the outward area vectors of the boundary triangles around it [mm^2] (nodes, 3)."""
    nodes, tets = exact.trunk.nodes, exact.trunk.tets
    vectors = np.zeros_like(nodes)
    for corners in ([1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]):  # outward; inside the two sides cancel
        a, b, c = (nodes[tets[:, corner]] for corner in corners)
        for corner in corners:
            np.add.at(vectors, tets[:, corner], np.cross(b - a, c - a) / 6.0)
    return vectors


@pytest.mark.parametrize("solver", SOLVERS)
def test_patch_and_rigid_motion(solver: str) -> None:
    """Nodes all around carried by one affine map carry those inside with them, and a turn costs nothing."""
    stretch = np.array([[1.2, 0.1, -0.2], [0.05, 0.85, 0.1], [0.0, -0.15, 1.1]])
    exact = affine(brick(3, all_around, 0.15), rotation(50.0, (1.0, 2.0, 3.0)) @ stretch)
    assert farthest(exact, solve(solver, exact, 0.49).displacement) < 1e-8
    exact = affine(brick(3, the_ends, 0.15), rotation(120.0, (1.0, -2.0, 0.5)))
    solved = solve(solver, exact, 0.45)
    assert farthest(exact, solved.displacement) < 1e-8
    assert abs(solved.energy) < 1e-12
    assert np.abs(solved.forces).max() < 1e-9


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(("stretch", "nu"), [(0.7, 0.49), (1.5, 0.3)])
def test_pulled_and_pressed(solver: str, stretch: float, nu: float) -> None:
    exact, stress = pulled(stretch, nu)
    solved = solve(solver, exact, nu)
    assert farthest(exact, solved.displacement) < 1e-7
    top = exact.trunk.nodes[:, 2] > 39.9
    np.testing.assert_allclose(solved.forces[top].sum(axis=0) / 900.0, [0.0, 0.0, 1e-3 * stress], atol=1e-9)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("nu", [0.3, 0.49])
def test_simple_shear(solver: str, nu: float) -> None:
    """Energy of the whole and the force on every node all around, P times its area vector."""
    exact, stress, energy = sheared(0.7, nu)
    solved = solve(solver, exact, nu)
    assert farthest(exact, solved.displacement) < 1e-8
    assert solved.energy == pytest.approx(1e-3 * energy * 27000.0, rel=1e-9)
    np.testing.assert_allclose(solved.forces, 1e-3 * area_vectors(exact) @ stress.T, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("solver", SOLVERS)
def test_order_of_convergence(solver: str) -> None:
    """The L2 error of the displacement falls as the square of the mesh size."""
    sizes, errors = (4, 8), []
    for cells in sizes:
        exact = hanging(cells, 0.45)
        errors.append(distance_l2(exact, solve(solver, exact, 0.45).displacement))
    order = np.log(errors[0] / errors[1]) / np.log(sizes[1] / sizes[0])
    assert order == pytest.approx(2.0, abs=0.2)


def distance_l2(exact: Exact, displacement: np.ndarray) -> float:
    """L2 norm of the error of linear elements, by quadrature of degree 5."""
    basis = Basis(tet_mesh(exact.trunk.nodes, exact.trunk.tets), ElementTetP1(), intorder=5)
    X = np.asarray(basis.global_coordinates()).transpose(1, 2, 0)
    interpolated = np.stack([np.asarray(basis.interpolate(component)) for component in displacement.T], axis=-1)
    wanted = exact.displacement(X.reshape(-1, 3)).reshape(X.shape)
    return float(np.sqrt((((interpolated - wanted) ** 2).sum(axis=-1) * basis.dx).sum()))


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


@pytest.mark.parametrize("nu", [0.0, 0.45])
def test_hookes_law_at_rest(nu: float) -> None:
    """A small strain e gives the stress E / (1 + nu) (e + nu / (1 - 2 nu) tr e), a small rotation none."""
    rest, moduli = np.eye(3)[None], stable(10.0, nu)
    gradient = np.random.default_rng(1).normal(size=(3, 3))
    strain = 0.5 * (gradient + gradient.T)
    wanted = 10.0 / (1.0 + nu) * (strain + nu / (1.0 - 2.0 * nu) * np.trace(strain) * np.eye(3))
    stresses = np.einsum("ijkl,kl->ij", tangent(rest, *moduli)[0], gradient)
    np.testing.assert_allclose(stresses, wanted, rtol=1e-11, atol=1e-11)
