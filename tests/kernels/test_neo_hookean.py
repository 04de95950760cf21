"""The stable neo-Hookean material in float64: energies and stresses, forces and curvatures of a tetrahedron."""

# Warp's annotations are values:
# pyright: reportInvalidTypeForm=false

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp
from warp_trunk.kernels.assembly import PAIRS, vec10i
from warp_trunk.kernels.neo_hookean import neo_hookean, neo_hookean_kernels

from support.continuum import lame, parts, stress
from support.matrices import element_matrices, places_apart
from support.meshes import rotation
from warp_trunk.engine.energies.neo_hookean import stable_moduli
from warp_trunk.engine.tissue import Tissue

MU, BULK = 1.7, 23.0
RATIOS = [0.0, 0.3, 0.45, 0.49]
SIZES = [1e-3, 1.0, 1e3]
TETS = 12
"""Cases of each kind."""


def deformations() -> dict[str, np.ndarray]:
    """Deformation gradients (cases, 3, 3) from none to inside out."""
    noise = np.random.default_rng(3).normal(size=(TETS, 3, 3))
    turns = np.stack([rotation(31.0 * n, (1.0, n, -n)) for n in range(TETS)])
    return {
        "turned": turns,
        "small": turns + 1e-3 * noise,
        "random": np.eye(3) + 0.3 * noise,
        "stretched": turns @ (1.6 * np.eye(3) + 0.1 * noise),
        "long and thin": turns @ (np.diag([3.0, 0.6, 0.6]) + 0.05 * noise),
        "compressed": 0.4 * turns + 0.05 * noise,
        "flat": turns @ np.diag([1.2, 1.1, 0.0]),
        "a needle": turns @ np.diag([1.2, 0.0, 0.0]),
        "a point": np.zeros((TETS, 3, 3)),
        "inverted": turns @ np.diag([1.0, 1.0, -1.0]) + 0.1 * noise,
        "inverted and blown up": -3.0 * turns + 0.2 * noise,
    }


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
    mu, lam = lame(8e-3, tissue.poisson_ratio)
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


class Corners:
    """Separate tetrahedra, each with blocks of its own, as the fused kernels see them."""

    def __init__(self, rest: np.ndarray, mu: float, bulk: float) -> None:
        self.rest = rest
        """Edge vectors from corner 0, as rows, shape (tets, 3, 3)."""
        self.volume = np.linalg.det(rest) / 6.0
        self.shape_gradient = np.linalg.inv(rest).transpose(0, 2, 1)
        self.kernels = neo_hookean_kernels(wp.float64, False, False, False)
        self.elements = [
            self.array(np.arange(4 * len(rest)).reshape(-1, 4), wp.vec4i),
            self.kernels.bundle(
                SimpleNamespace(
                    shape_gradient=self.array(self.shape_gradient, wp.vec3d),
                    rest_volume=self.array(self.volume, wp.float64),
                    moduli=self.array([[mu, bulk]], wp.vec2d),
                    gravity_weight=self.array([0.0], wp.float64),
                )
            ),
        ]

    @staticmethod
    def array(values: object, dtype: type) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device="cpu")

    def displacement(self, f: np.ndarray) -> np.ndarray:
        """That carries corner 0 nowhere and the others by F, shape (tets, 4, 3)."""
        out = np.zeros((len(f), 4, 3))
        out[:, 1:] = self.rest @ f.transpose(0, 2, 1) - self.rest
        return out

    def gradient(self, displacement: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of every corner (tets, 4, 3), and which tetrahedra are inverted."""
        count = len(self.rest)
        gradient = wp.zeros((1, 4 * count), dtype=wp.vec3d, device="cpu")
        inverted = wp.zeros(count, dtype=wp.int8, device="cpu")
        sums = wp.zeros((1, 8), dtype=wp.float64, device="cpu")
        inputs = [0, count, 0, *self.elements, inverted, self.array(displacement.reshape(-1, 3), wp.vec3d)]
        wp.launch(self.kernels.gradient, 1, inputs, [gradient, inverted, sums], device="cpu")
        return gradient.numpy().reshape(-1, 4, 3), inverted.numpy() == 1

    def curvature(self, displacement: np.ndarray) -> np.ndarray:
        """Of every tetrahedron, shape (tets, 12, 12)."""
        count = len(self.rest)
        blocks = wp.zeros(len(PAIRS) * count, dtype=wp.mat33d, device="cpu")
        places = self.array(places_apart(count), vec10i)
        inputs = [0, count, 0, *self.elements, places, self.array(displacement.reshape(-1, 3), wp.vec3d)]
        wp.launch(self.kernels.projected_hessian, 1, inputs, [blocks], device="cpu")
        return element_matrices(blocks.numpy())

    def exact_curvature(self, displacement: np.ndarray) -> np.ndarray:
        """Central differences of the gradient."""
        step = 1e-5 * np.cbrt(np.abs(self.volume)).max()
        columns = []
        for corner, axis in np.ndindex(4, 3):
            move = np.zeros((4, 3))
            move[corner, axis] = step
            change = self.gradient(displacement + move)[0] - self.gradient(displacement - move)[0]
            columns.append(change.reshape(len(displacement), 12) / (2.0 * step))
        return np.stack(columns, axis=1)


def corners(size: float = 1.0, ratio: float = 0.45) -> Corners:
    """Well-shaped random tetrahedra."""
    noise = np.random.default_rng(2).normal(scale=0.2, size=(TETS, 3, 3))
    turns = np.stack([rotation(37.0 * n, (1.0, n, -n * n)) for n in range(TETS)])
    return Corners(size * (np.eye(3) + noise) @ turns, *stable_moduli(Tissue(poisson_ratio=ratio)))


@pytest.mark.parametrize("size", SIZES)
def test_forces_pull_and_turn_nothing(size: float) -> None:
    tets = corners(size)
    for state, f in deformations().items():
        displacement = tets.displacement(f)
        gradient, inverted = tets.gradient(displacement)
        now = displacement + np.concatenate([np.zeros((TETS, 1, 3)), tets.rest], axis=1)
        scale = max(np.abs(gradient).max(), 1e-6 * size**2)
        np.testing.assert_allclose(gradient.sum(axis=1), 0.0, atol=1e-13 * scale, err_msg=state)
        np.testing.assert_allclose(
            np.cross(now, gradient).sum(axis=1), 0.0, atol=1e-12 * scale * size, err_msg=state
        )
        volume = np.linalg.det(f)
        assert (inverted == (volume <= 0.0))[np.abs(volume) > 1e-9].all(), state


@pytest.mark.parametrize("size", SIZES)
def test_force_is_the_stress_on_the_faces(size: float) -> None:
    """Corner k is pulled by V0 P r_k, r_k the gradient of its shape function; it grows as the area."""
    tets = corners(size)
    mu, bulk = stable_moduli(Tissue(poisson_ratio=0.45))
    f = deformations()["random"]
    wanted = np.einsum("t,tij,tkj->tki", tets.volume, stress(f, mu, bulk), tets.shape_gradient)
    gradient = tets.gradient(tets.displacement(f))[0]
    np.testing.assert_allclose(gradient[:, 1:], wanted, rtol=1e-10, atol=1e-12 * np.abs(wanted).max())


@pytest.mark.parametrize("ratio", RATIOS)
def test_curvature_is_exact_at_rest(ratio: float) -> None:
    tets = corners(10.0, ratio)
    rest = np.zeros((TETS, 4, 3))
    exact = tets.exact_curvature(rest)
    np.testing.assert_allclose(tets.curvature(rest), exact, rtol=0.0, atol=1e-7 * np.abs(exact).max())


@pytest.mark.parametrize("ratio", [0.3, 0.49])
def test_curvature_is_exact_where_it_is_positive_anyway(ratio: float) -> None:
    """Tetrahedra pulled a little in every direction: three motions cost nothing, none gains."""
    tets = corners(10.0, ratio)
    noise = np.random.default_rng(5).normal(scale=0.001, size=(TETS, 3, 3))
    displacement = tets.displacement(1.003 * np.eye(3) + noise)
    exact = tets.exact_curvature(displacement)
    positive = np.linalg.eigvalsh(exact)[:, 3] > 1e-6 * np.abs(exact).max()
    assert positive.sum() >= TETS // 2
    found = tets.curvature(displacement)
    np.testing.assert_allclose(found[positive], exact[positive], rtol=0.0, atol=1e-7 * np.abs(exact).max())


@pytest.mark.parametrize("ratio", [*RATIOS, 0.499])
def test_curvature_is_positive_semidefinite_everywhere(ratio: float) -> None:
    tets = corners(10.0, ratio)
    rng = np.random.default_rng(6)
    states = deformations()
    for scale in (0.02, 0.1, 0.5, 2.0):
        for number in range(20):
            states[f"{scale} {number}"] = np.eye(3) + scale * rng.normal(size=(TETS, 3, 3))
    for state, f in states.items():
        curvature = tets.curvature(tets.displacement(f))
        assert np.isfinite(curvature).all(), state
        largest = np.abs(curvature).max(axis=(1, 2))
        np.testing.assert_allclose(curvature, curvature.transpose(0, 2, 1), rtol=0.0, atol=1e-13 * largest.max())
        assert (np.linalg.eigvalsh(curvature)[:, 0] >= -1e-8 * largest - 1e-15).all(), state


def test_a_sliver_stays_finite() -> None:
    """A tetrahedron a billionth as high as wide, stretched by a hundredth."""
    rest = np.array([[[1.0, 0.0, 0.0], [0.3, 1.0, 0.0], [0.2, 0.3, 1e-9]]])
    sliver = Corners(rest, MU, BULK)
    displacement = sliver.displacement(np.array([1.01 * np.eye(3)]))
    gradient, inverted = sliver.gradient(displacement)
    wanted = sliver.volume[0] * stress(1.01 * np.eye(3), MU, BULK) @ sliver.shape_gradient[0].T
    np.testing.assert_allclose(gradient[0, 1:].T, wanted, rtol=1e-5, atol=1e-9 * np.abs(wanted).max())
    assert np.isfinite(sliver.curvature(displacement)).all()
    assert not inverted[0]
