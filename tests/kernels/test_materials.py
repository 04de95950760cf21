"""The springs of [2] and the stable neo-Hookean material: energies, stresses, forces, curvatures of tetrahedra."""

# Warp's annotations are values:
# pyright: reportInvalidTypeForm=false

from functools import cache
from typing import Any

import numpy as np
import pytest
import warp as wp
from warp_trunk.kernels.neo_hookean import neo_hookean

from support.continuum import lame, parts, stress
from support.meshes import rotation, trunk
from support.models import dense_hessian, differenced_gradient, evaluated, gradient_of, model_of
from warp_trunk.engine.energies.neo_hookean import stable_moduli
from warp_trunk.engine.model import Model
from warp_trunk.engine.tissue import Tissue

MU, BULK = 1.7, 23.0
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


def test_energy_of_small_strains_keeps_its_digits() -> None:
    """mu_L e:e + lambda_L/2 (tr e)^2 in float32, where the paper's own form would leave only rounding."""
    tissue = Tissue(youngs_modulus=8.0)
    strain = np.random.default_rng(2).normal(size=(TETS, 3, 3))
    strain = 1e-4 * (strain + strain.transpose(0, 2, 1))
    mu, lam = lame(8e-3, tissue.poisson_ratio)
    wanted = mu * (strain**2).sum(axis=(1, 2)) + 0.5 * lam * np.trace(strain, axis1=1, axis2=2) ** 2
    energy = material(strain, *stable_moduli(tissue), wp.float32)[0]
    np.testing.assert_allclose(energy[:, :2].sum(axis=1), wanted, rtol=5e-3)


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


def separate(size: float = 1.0, ratio: float = 0.45, energy: str = "neo-hookean") -> Model:
    """Well-shaped random tetrahedra, each with corners of its own, the first at the origin."""
    noise = np.random.default_rng(2).normal(scale=0.2, size=(TETS, 3, 3))
    turns = np.stack([rotation(37.0 * n, (1.0, n, -n * n)) for n in range(TETS)])
    return tets_of(size * (np.eye(3) + noise) @ turns, Tissue(poisson_ratio=ratio), energy)


def tets_of(edges: np.ndarray, tissue: Tissue, energy: str = "neo-hookean") -> Model:
    """Of edge vectors from the first corner, as rows, shape (tets, 3, 3)."""
    nodes = np.concatenate([np.zeros((len(edges), 1, 3)), edges], axis=1).reshape(-1, 3)
    number = np.arange(len(nodes))
    return model_of(trunk(nodes, number.reshape(-1, 4), number % 4 < 3), tissue, energy=energy)


def rest_of(model: Model) -> np.ndarray:
    """Corners at rest in the order of the mesh, shape (tets, 4, 3)."""
    return model.rest[np.argsort(model.order)].reshape(-1, 4, 3)


def moved(model: Model, f: np.ndarray) -> np.ndarray:
    """The displacement that carries corner 0 nowhere and the others by F."""
    return (rest_of(model) @ (f - np.eye(3)).transpose(0, 2, 1)).reshape(-1, 3)


def of_each(dense: np.ndarray) -> np.ndarray:
    """The blocks of each tetrahedron, shape (tets, 12, 12)."""
    own = np.arange(len(dense) // 12)
    return dense.reshape(len(own), 12, len(own), 12)[own, :, own]


def projected(model: Model, displacement: np.ndarray) -> np.ndarray:
    return of_each(dense_hessian(model, displacement, "projected_hessian"))


@pytest.mark.parametrize("size", SIZES)
def test_force_is_the_stress_on_the_faces(size: float) -> None:
    """Corner k is pulled by V0 P r_k, r_k the gradient of its shape function; it grows as the area."""
    model, f = separate(size), deformations()["random"]
    edges = rest_of(model)[:, 1:]
    volume, shape_gradient = np.linalg.det(edges) / 6.0, np.linalg.inv(edges).transpose(0, 2, 1)
    mu, bulk = stable_moduli(model.tissues[0])
    wanted = np.einsum("t,tij,tkj->tki", volume, stress(f, mu, bulk), shape_gradient)
    gradient = gradient_of(evaluated(model, moved(model, f))).reshape(-1, 4, 3)
    np.testing.assert_allclose(gradient[:, 1:], wanted, rtol=1e-10, atol=1e-12 * np.abs(wanted).max())


@pytest.mark.parametrize("ratio", [0.0, 0.3, 0.45, 0.49])
def test_curvature_is_exact_at_rest_and_where_it_is_positive_anyway(ratio: float) -> None:
    """Tetrahedra pulled a little in every direction: three motions cost nothing, none gains."""
    model = separate(10.0, ratio)
    noise = np.random.default_rng(5).normal(scale=0.001, size=(TETS, 3, 3))
    for f in (np.tile(np.eye(3), (TETS, 1, 1)), 1.003 * np.eye(3) + noise):
        exact, curvature = of_each(differenced_gradient(model, moved(model, f))), projected(model, moved(model, f))
        positive = np.linalg.eigvalsh(exact)[:, 3] > 1e-6 * np.abs(exact).max()
        positive |= (f == np.eye(3)).all(axis=(1, 2))
        assert positive.sum() >= TETS // 2
        np.testing.assert_allclose(curvature[positive], exact[positive], rtol=0.0, atol=1e-7 * np.abs(exact).max())


@pytest.mark.parametrize(
    ("energy", "ratio"), [("itmsm", 0.45), *(("neo-hookean", ratio) for ratio in (0.0, 0.3, 0.45, 0.499))]
)
def test_curvature_is_positive_semidefinite_everywhere(energy: str, ratio: float) -> None:
    model, rng, states = separate(10.0, ratio, energy), np.random.default_rng(6), deformations()
    for scale in (0.02, 0.1, 0.5, 2.0):
        for number in range(20):
            states[f"{scale} {number}"] = np.eye(3) + scale * rng.normal(size=(TETS, 3, 3))
    for state, f in states.items():
        curvature = projected(model, moved(model, f))
        assert np.isfinite(curvature).all(), state
        assert np.isfinite(gradient_of(evaluated(model, moved(model, f)))).all(), state
        largest = np.abs(curvature).max(axis=(1, 2))
        np.testing.assert_allclose(curvature, curvature.transpose(0, 2, 1), rtol=0.0, atol=1e-13 * largest.max())
        assert (np.linalg.eigvalsh(curvature)[:, 0] >= -1e-8 * largest - 1e-15).all(), state


@pytest.mark.parametrize("size", SIZES)
def test_springs_by_hand(size: float) -> None:
    """Grown by 2 and by 3: each length by 1 and 2 of itself, each area by 3 and 8, each volume by 7 and 26; inside
    out a volume lacks twice itself."""
    model = separate(size, energy="itmsm")

    def terms(scale: float) -> dict[str, float]:
        return evaluated(model, moved(model, np.tile(scale * np.eye(3), (TETS, 1, 1)))).energy().terms

    for name, (twice, thrice) in {"distance": (1, 2), "area": (3, 8), "volume": (7, 26)}.items():
        assert terms(3.0)[name] / terms(2.0)[name] == pytest.approx((thrice / twice) ** 2, rel=1e-12)
    assert terms(-1.0)["distance"] == pytest.approx(0.0, abs=1e-20)
    assert terms(-1.0)["volume"] / terms(2.0)["volume"] == pytest.approx((2 / 7) ** 2, rel=1e-12)


def test_curvature_of_stretched_edges_is_exact() -> None:
    edges = tets_of(10.0 * np.eye(3)[None], Tissue(epsilon=0.0, theta=0.0, poisson_ratio=0.0), "itmsm")
    stretched = moved(edges, np.array([np.diag([1.8, 1.5, 2.1])]))
    exact = of_each(differenced_gradient(edges, stretched))
    np.testing.assert_allclose(projected(edges, stretched), exact, rtol=0.0, atol=1e-7 * np.abs(exact).max())


def test_a_sliver_stays_finite() -> None:
    """A tetrahedron a billionth as high as wide, stretched by a hundredth."""
    edges, f = np.array([[[1.0, 0.0, 0.0], [0.3, 1.0, 0.0], [0.2, 0.3, 1e-9]]]), np.array([1.01 * np.eye(3)])
    sliver = tets_of(edges, Tissue())
    state = evaluated(sliver, moved(sliver, f))
    wanted = np.linalg.det(edges[0]) / 6.0 * stress(f[0], *stable_moduli(Tissue())) @ np.linalg.inv(edges[0])
    np.testing.assert_allclose(gradient_of(state)[1:].T, wanted, rtol=1e-5, atol=1e-8 * np.abs(wanted).max())
    assert np.isfinite(projected(sliver, moved(sliver, f))).all()
    assert state.read()[1] == 0
