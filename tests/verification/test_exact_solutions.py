"""Both solvers, scikit-fem and warp_trunk, against equilibria of the neo-Hookean energy that are known exactly."""

from collections.abc import Callable

import numpy as np
import pytest
from skfem import Basis, ElementTetP1

from support.exact_solutions import (
    SOLVERS,
    Exact,
    Found,
    affine,
    all_around,
    brick,
    hanging,
    pulled,
    sheared,
    swollen,
    the_ends,
)
from support.finite_elements import tet_mesh
from support.meshes import rotation

pytestmark = pytest.mark.parametrize("solver", SOLVERS)
RATIOS = (0.3, 0.45, 0.49)


def solve(solver: str, exact: Exact, nu: float) -> Found:
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


@pytest.mark.parametrize("nu", RATIOS)
def test_patch(solver: str, nu: float) -> None:
    """Nodes all around carried by one affine map carry those inside an irregular mesh with them."""
    stretch = np.array([[1.2, 0.1, -0.2], [0.05, 0.85, 0.1], [0.0, -0.15, 1.1]])
    exact = affine(brick(3, all_around, 0.15), rotation(50.0, (1.0, 2.0, 3.0)) @ stretch)
    assert farthest(exact, solve(solver, exact, nu).displacement) < 1e-8


def test_rigid_motion(solver: str) -> None:
    """Held at its ends, a bar that turns by 120 degrees turns as a whole, without energy and without force."""
    exact = affine(brick(3, the_ends, 0.15), rotation(120.0, (1.0, -2.0, 0.5)))
    found = solve(solver, exact, 0.45)
    assert farthest(exact, found.displacement) < 1e-8
    assert abs(found.energy) < 1e-12
    assert np.abs(found.forces).max() < 1e-9


@pytest.mark.parametrize("nu", RATIOS)
@pytest.mark.parametrize("stretch", [0.7, 1.5])
def test_pulled_and_pressed(solver: str, stretch: float, nu: float) -> None:
    exact, stress = pulled(stretch, nu)
    found = solve(solver, exact, nu)
    assert farthest(exact, found.displacement) < 1e-7
    top = exact.trunk.nodes[:, 2] > 39.9
    np.testing.assert_allclose(found.forces[top].sum(axis=0) / 900.0, [0.0, 0.0, 1e-3 * stress], atol=1e-9)


@pytest.mark.parametrize("nu", RATIOS)
def test_simple_shear(solver: str, nu: float) -> None:
    """Energy of the whole and the force on every node all around, P times its area vector."""
    exact, stress, energy = sheared(0.7, nu)
    found = solve(solver, exact, nu)
    assert farthest(exact, found.displacement) < 1e-8
    assert found.energy == pytest.approx(1e-3 * energy * 27000.0, rel=1e-9)
    np.testing.assert_allclose(found.forces, 1e-3 * area_vectors(exact) @ stress.T, atol=1e-9)


@pytest.mark.parametrize(("nu", "make"), [(0.3, swollen), (0.45, swollen), (0.3, hanging), (0.45, hanging)])
def test_order_of_convergence(solver: str, make: Callable[[int, float], Exact], nu: float) -> None:
    """The L2 error of the displacement falls as the square of the mesh size."""
    sizes, errors = (4, 8), []
    for cells in sizes:
        exact = make(cells, nu)
        errors.append(distance_l2(exact, solve(solver, exact, nu).displacement))
    order = np.log(errors[0] / errors[1]) / np.log(sizes[1] / sizes[0])
    assert order == pytest.approx(2.0, abs=0.2)


def distance_l2(exact: Exact, displacement: np.ndarray) -> float:
    """L2 norm of the error of linear elements, by quadrature of degree 5."""
    basis = Basis(tet_mesh(exact.trunk.nodes, exact.trunk.tets), ElementTetP1(), intorder=5)
    X = np.asarray(basis.global_coordinates()).transpose(1, 2, 0)
    found = np.stack([np.asarray(basis.interpolate(component)) for component in displacement.T], axis=-1)
    wanted = exact.displacement(X.reshape(-1, 3)).reshape(X.shape)
    return float(np.sqrt((((found - wanted) ** 2).sum(axis=-1) * basis.dx).sum()))
