"""The stable neo-Hookean material: energies and stresses of a deformation, in float64."""

# Warp's annotations are values:
# pyright: reportInvalidTypeForm=false

from functools import cache
from typing import Any

import numpy as np
import pytest
import warp as wp
from warp_trunk.kernels.neo_hookean import neo_hookean

from support.continuum import lame, parts, stress
from support.deformations import TETS, deformations
from support.meshes import rotation
from warp_trunk.engine.energies.neo_hookean import stable_moduli
from warp_trunk.engine.tissue import Tissue

MU, BULK = 1.7, 23.0
RATIOS = [0.0, 0.3, 0.45, 0.49]


@cache
def material_kernel(scalar: type) -> Any:
    mat33 = wp.types.matrix((3, 3), scalar)

    @wp.kernel(enable_backward=False, module="unique")
    def kernel(
        h: wp.array(dtype=mat33),
        mu: scalar,
        bulk: scalar,
        energy: wp.array2d(dtype=scalar),
        piola: wp.array(dtype=mat33),
    ):
        t = wp.tid()
        shape, volume, stress, growth = neo_hookean(h[t], mu, bulk)
        energy[t, 0] = shape
        energy[t, 1] = volume
        energy[t, 2] = growth
        piola[t] = stress

    return kernel


def material(
    h: np.ndarray, mu: float = MU, bulk: float = BULK, scalar: type = wp.float64
) -> tuple[np.ndarray, np.ndarray]:
    """Shape and volume energies with det F - 1, shape (cases, 3), and stresses (cases, 3, 3), of H = F - I."""
    mat33 = wp.types.matrix((3, 3), scalar)
    energy = wp.zeros((len(h), 3), dtype=scalar, device="cpu")
    piola = wp.zeros(len(h), dtype=mat33, device="cpu")
    inputs = [wp.array(h, dtype=mat33, device="cpu"), scalar(mu), scalar(bulk)]
    wp.launch(material_kernel(scalar), dim=len(h), inputs=inputs, outputs=[energy, piola], device="cpu")
    return energy.numpy(), piola.numpy()


@pytest.mark.parametrize("state", deformations())
def test_energy_and_stress_are_the_papers(state: str) -> None:
    f = deformations()[state]
    energy, piola = material(f - np.eye(3))
    shape, volume = parts(f, MU, BULK)
    np.testing.assert_allclose(energy[:, 0], shape, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(energy[:, 1], volume, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(energy[:, 2], np.linalg.det(f) - 1.0, rtol=1e-12, atol=1e-13)
    wanted = stress(f, MU, BULK)
    np.testing.assert_allclose(piola, wanted, rtol=1e-12, atol=1e-12 * max(1.0, np.abs(wanted).max()))


@pytest.mark.parametrize("state", deformations())
def test_stress_is_the_derivative_of_the_energy(state: str) -> None:
    f, step = deformations()[state], 1e-5
    numeric = np.empty_like(f)

    def energy(f: np.ndarray) -> np.ndarray:
        return material(f - np.eye(3))[0][:, :2].sum(axis=1)

    for i, k in np.ndindex(3, 3):
        move = np.zeros((3, 3))
        move[i, k] = step
        numeric[:, i, k] = (energy(f + move) - energy(f - move)) / (2.0 * step)
    rounding = 1e-6 * max(1.0, 0.01 * np.abs(numeric).max())  # of volumes, times 131 lambda over the step
    np.testing.assert_allclose(material(f - np.eye(3))[1], numeric, rtol=1e-7, atol=rounding)


def test_nothing_at_rest() -> None:
    energy, piola = material(np.zeros((1, 3, 3)))
    assert (energy == 0.0).all()
    assert (piola == 0.0).all()


@pytest.mark.parametrize("ratio", RATIOS)
def test_small_strains_obey_hooke(ratio: float) -> None:
    """P = E / (1 + nu) (e + nu / (1 - 2 nu) tr e I), to first order in a strain of 1e-7."""
    tissue = Tissue(youngs_modulus=8.0, poisson_ratio=ratio)
    strain = np.random.default_rng(1).normal(size=(TETS, 3, 3))
    strain = 1e-7 * (strain + strain.transpose(0, 2, 1))
    trace = np.trace(strain, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    hooke = 8e-3 / (1.0 + ratio) * (strain + ratio / (1.0 - 2.0 * ratio) * trace)
    piola = material(strain, *stable_moduli(tissue))[1]
    np.testing.assert_allclose(piola, hooke, rtol=0.0, atol=1e-5 * np.abs(hooke).max())


def test_energy_of_small_strains_keeps_its_digits() -> None:
    """mu_L e:e + lambda_L/2 (tr e)^2 in float32, where the paper's own form would leave only rounding."""
    tissue = Tissue(youngs_modulus=8.0)
    strain = np.random.default_rng(2).normal(size=(TETS, 3, 3))
    strain = 1e-4 * (strain + strain.transpose(0, 2, 1))
    mu, lam = lame(tissue)
    wanted = mu * (strain**2).sum(axis=(1, 2)) + 0.5 * lam * np.trace(strain, axis1=1, axis2=2) ** 2
    energy = material(strain, *stable_moduli(tissue), wp.float32)[0]
    np.testing.assert_allclose(energy[:, :2].sum(axis=1), wanted, rtol=5e-3)


def test_simple_shear_by_hand() -> None:
    """A shear keeps the volume, so the Cauchy stress is mu (1 - 1 / (4 + gamma^2)) F F^T - 3/4 mu I."""
    gamma = np.array([0.1, 1.0, 3.0])
    f = np.tile(np.eye(3), (3, 1, 1))
    f[:, 0, 1] = gamma
    cauchy = material(f - np.eye(3))[1] @ f.transpose(0, 2, 1)
    weight = 1.0 - 1.0 / (4.0 + gamma**2)
    np.testing.assert_allclose(cauchy[:, 0, 1], MU * gamma * weight, rtol=1e-13)
    np.testing.assert_allclose(cauchy[:, 0, 0], MU * ((1.0 + gamma**2) * weight - 0.75), rtol=1e-13)
    np.testing.assert_allclose(cauchy[:, 2, 2], MU * (weight - 0.75), rtol=1e-12)


def test_crushed_by_hand() -> None:
    """Pressed flat, det F = 0, and to a quarter and a half of its volume, where the last has the paper's alone.

    To a quarter 400 / 4^4 and 1600 / 4^3 times lambda are added; flat, 129.6 of 43.2 + 432 / 5 press back, over
    3.24 + 43.2 / 5 + 216 / 5^2.
    """
    energy, piola = material(np.array([np.diag([0.0, 0.0, -missing]) for missing in (1.0, 0.75, 0.5)]))
    wanted = [0.5 + 3.24 + 8.64 + 8.64, 0.75**2 / 2.0 + 400.0 / 256.0, 0.125]
    np.testing.assert_allclose(energy[:, 1], BULK * np.array(wanted), rtol=1e-14)
    np.testing.assert_allclose(piola[0, 2, 2], -0.75 * MU - (1.0 + 129.6) * BULK, rtol=1e-14)
    along = MU * (0.25 * (1.0 - 1.0 / (2.0 + 0.25**2 + 1.0)) - 0.75)
    np.testing.assert_allclose(piola[1, 2, 2], along - (0.75 + 25.0) * BULK, rtol=1e-14)


def test_rotations_before_and_after_change_nothing_but_the_axes() -> None:
    first, second = rotation(71.0, (1.0, -2.0, 0.4)), rotation(200.0, (0.3, 1.0, 1.0))
    for state, f in deformations().items():
        energy, piola = material(f - np.eye(3))
        turned_energy, turned_piola = material(second @ f @ first - np.eye(3))
        np.testing.assert_allclose(turned_energy, energy, rtol=1e-11, atol=1e-12, err_msg=state)
        np.testing.assert_allclose(turned_piola, second @ piola @ first, rtol=1e-10, atol=1e-11, err_msg=state)
