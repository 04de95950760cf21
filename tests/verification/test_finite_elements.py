"""warp_trunk's neo-Hookean equilibria against those of an independent solver, and that solver against itself."""

from collections.abc import Callable

import numpy as np
import pytest

from support.continuum import parts, stable, stress
from support.exact_solutions import SOLVERS
from support.finite_elements import Solid, equilibrium, tangent
from support.meshes import block, block_with_bone, rotate, rotation
from warp_trunk.engine.trunk_mesh import TrunkMesh


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
    angle = np.radians(90.0) * np.clip(z / 60.0, 0.0, 1.0) * np.where(trunk.prescribed, z > 30.0, 1.0)
    angle[trunk.prescribed & (z > 30.0)] = np.radians(90.0)
    x, y = trunk.nodes[:, 0] - 15.0, trunk.nodes[:, 1] - 15.0
    c, s = np.cos(angle), np.sin(angle)
    return trunk, np.column_stack([c * x - s * y - x, s * x + c * y - y, np.zeros_like(x)])


@pytest.mark.parametrize("gravity", [0.0, 9.81])
@pytest.mark.parametrize("nu", [0.3, 0.45, 0.49])
@pytest.mark.parametrize("scene", [moved_bone, turned_end])
def test_same_equilibrium(scene: Callable[[], tuple[TrunkMesh, np.ndarray]], nu: float, gravity: float) -> None:
    """Every node to 1e-6 mm, the energy and the forces that hold the bones to nine digits."""
    trunk, start = scene()
    wanted, found = (SOLVERS[name](trunk, start, nu, gravity) for name in ("scikit-fem", "warp_trunk"))
    assert np.linalg.norm(wanted.displacement - start, axis=1).max() > 1.0
    assert np.linalg.norm(found.displacement - wanted.displacement, axis=1).max() < 1e-6
    assert found.energy == pytest.approx(wanted.energy, rel=1e-9)
    np.testing.assert_allclose(found.forces, wanted.forces, atol=1e-8 * np.abs(wanted.forces).max())


@pytest.fixture(scope="module")
def deformations() -> np.ndarray:
    """Deformation gradients, inverted ones too, shape (20, 3, 3)."""
    return np.eye(3) + 0.6 * np.random.default_rng(0).normal(size=(20, 3, 3))


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.45, 0.49])
def test_stress_and_tangent_by_differences(deformations: np.ndarray, nu: float) -> None:
    moduli, step = stable(10.0, nu), 1e-5
    assert 0 < (np.linalg.det(deformations) < 0.0).sum() < 10
    found, second = stress(deformations, *moduli), tangent(deformations, *moduli)
    for k, l in np.ndindex(3, 3):  # noqa: E741
        move = np.zeros((3, 3))
        move[k, l] = step
        ahead, behind = deformations + move, deformations - move
        slope = (sum(parts(ahead, *moduli)) - sum(parts(behind, *moduli))) / (2.0 * step)
        np.testing.assert_allclose(found[:, k, l], slope, rtol=1e-7, atol=1e-8 * np.abs(slope).max())
        slope = (stress(ahead, *moduli) - stress(behind, *moduli)) / (2.0 * step)
        np.testing.assert_allclose(second[:, :, :, k, l], slope, rtol=1e-7, atol=1e-8 * np.abs(slope).max())


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.45, 0.49])
def test_hookes_law_at_rest(nu: float) -> None:
    """A small strain e gives the stress E / (1 + nu) (e + nu / (1 - 2 nu) tr e), a small rotation none."""
    rest, moduli = np.eye(3)[None], stable(10.0, nu)
    assert sum(parts(rest, *moduli)) == pytest.approx(0.0, abs=1e-14)
    np.testing.assert_allclose(stress(rest, *moduli), 0.0, atol=1e-13)
    gradient = np.random.default_rng(1).normal(size=(3, 3))
    strain = 0.5 * (gradient + gradient.T)
    wanted = 10.0 / (1.0 + nu) * (strain + nu / (1.0 - 2.0 * nu) * np.trace(strain) * np.eye(3))
    found = np.einsum("ijkl,kl->ij", tangent(rest, *moduli)[0], gradient)
    np.testing.assert_allclose(found, wanted, rtol=1e-11, atol=1e-11)


def test_energy_ignores_rotation_and_is_isotropic(deformations: np.ndarray) -> None:
    moduli, turn = stable(10.0, 0.45), rotation(130.0, (2.0, 1.0, -1.0))
    for turned in (turn @ deformations, deformations @ turn):
        for found, wanted in zip(parts(turned, *moduli), parts(deformations, *moduli), strict=True):
            np.testing.assert_allclose(found, wanted, rtol=1e-11, atol=1e-11)


def test_the_independent_solver_stays_at_rest_and_says_when_no_step_helps(monkeypatch) -> None:
    trunk = block((2, 2, 2))
    solid, still = Solid(trunk.nodes, trunk.tets, 1.0, 0.45), np.zeros_like(trunk.nodes)
    np.testing.assert_allclose(equilibrium(solid, still, trunk.prescribed), 0.0, atol=1e-12)
    forces = solid.forces
    monkeypatch.setattr(solid, "forces", lambda u: -forces(u))
    with pytest.raises(AssertionError, match="no step lowers the energy"):
        equilibrium(solid, still + 2.0 * ~trunk.prescribed[:, None], trunk.prescribed)
