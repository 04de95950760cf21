"""Exact equilibria of the stable neo-Hookean energy, each worked out by hand from its stress, and two solvers.

Lengths in mm, the modulus is 1 kPa: without gravity no displacement depends on it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import root_scalar

from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh

from .continuum import stable
from .finite_elements import Solid, equilibrium
from .meshes import grid, trunk
from .models import evaluated, gradient_of, model_of, relax

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
        there = self.displacement(self.trunk.nodes)
        affine_map = np.linalg.lstsq(points[held], there[held], rcond=None)[0]
        noise = np.random.default_rng(4).uniform(-0.3, 0.3, there.shape)
        return np.where(held[:, None], there, points @ affine_map + noise)


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


def swollen(cells: int, nu: float) -> Exact:
    """A brick cut from a swollen sphere around the origin, where a point at R is carried to r(R).

    F has the stretches p = r' along the radius and q = r / R across, twice. Equilibrium along the radius,
    dP_p/dR + 2 (P_p - P_q) / R = 0, is an ordinary differential equation for r, solved to 1e-12.
    """
    mu, lam, alpha = constants(nu)

    def slope(R: float, r_and_p: np.ndarray) -> list[float]:
        r, p = r_and_p
        q = r / R
        squares, pressure = p**2 + 2.0 * q**2 + 1.0, lam * (p * q**2 - alpha)
        shear, shear_slope = mu * (1.0 - 1.0 / squares), mu / squares**2
        along, across = shear * p + pressure * q**2, shear * q + pressure * p * q
        by_p = shear + 2.0 * shear_slope * p**2 + lam * q**4
        by_q = 4.0 * shear_slope * p * q + 2.0 * lam * p * q**3 + 2.0 * pressure * q
        return [p, -(2.0 * (along - across) + by_q * (p - q)) / R / by_p]

    R = np.linspace(20.0, 80.0, 2001)
    solution = solve_ivp(slope, (20.0, 80.0), [30.0, 0.6], method="DOP853", t_eval=R, rtol=1e-12, atol=1e-12)
    radius = CubicHermiteSpline(R, *solution.y)

    def displacement(X: np.ndarray) -> np.ndarray:
        at = np.linalg.norm(X, axis=1)
        return X * (radius(at) / at - 1.0)[:, None]

    return Exact(brick(cells, all_around), displacement)


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
class Found:
    """Where a solver ended."""

    displacement: np.ndarray
    """Of all nodes [mm], shape (nodes, 3)."""
    energy: float
    """Elastic, less the work of the weight from rest [mJ]."""
    forces: np.ndarray
    """That hold the nodes [N], shape (nodes, 3)."""


def by_scikit_fem(trunk: TrunkMesh, start: np.ndarray, nu: float, gravity: float = 0.0) -> Found:
    solid = Solid(trunk.nodes, trunk.tets, 1e-3 * MODULUS, nu, 1e-9 * DENSITY * gravity)
    found = equilibrium(solid, start, trunk.prescribed)
    return Found(found, solid.energy(found), solid.forces(found))


def by_warp_trunk(trunk: TrunkMesh, start: np.ndarray, nu: float, gravity: float = 0.0) -> Found:
    tissue = Tissue(youngs_modulus=MODULUS, poisson_ratio=nu, density=DENSITY)
    model = model_of(trunk, tissue, threads=1, energy="neo-hookean", gravity=gravity)
    relaxation, found = relax(model, start, tolerance=1e-9)
    assert relaxation.status is RelaxStatus.CONVERGED, relaxation
    state = evaluated(model, found)
    return Found(found, state.energy().total - model.elements.gravity_at_rest, gradient_of(state))


SOLVERS = {"scikit-fem": by_scikit_fem, "warp_trunk": by_warp_trunk}
