"""The energy terms of eq. 4.12 to 4.14 of [2] one by one, in float64: values, gradients, curvatures."""

# Warp's annotations are values:
# pyright: reportInvalidTypeForm=false

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import warp as wp
from warp_trunk.kernels.itmsm import (
    area_hessian,
    area_term,
    distance_hessian,
    distance_term,
    volume_term,
)

from support.meshes import rotation

WEIGHT = 1.7
SIZES = [1e-3, 1.0, 1e3]
CURVED = ["distance", "area"]


@wp.kernel(enable_backward=False)
def terms_kernel(
    rest: wp.array2d(dtype=wp.vec3d),
    change: wp.array2d(dtype=wp.vec3d),
    measure: wp.array(dtype=wp.vec3d),
    weight: wp.float64,
    energy: wp.array2d(dtype=wp.float64),
    gradient: wp.array3d(dtype=wp.vec3d),
    curvature: wp.array4d(dtype=wp.mat33d),
):
    """Distance, area and volume, by term, of the edge vectors a, b and c from one corner."""
    t = wp.tid()
    a = rest[t, 0]
    b = rest[t, 1]
    c = rest[t, 2]
    da = change[t, 0]
    db = change[t, 1]
    dc = change[t, 2]
    distance, along = distance_term(a, da, measure[t][0], weight)
    energy[t, 0] = distance
    gradient[t, 0, 0] = along
    curvature[t, 0, 0, 0] = distance_hessian(a, da, measure[t][0], weight, True)
    growth, ga, gb = area_term(a, b, da, db, measure[t][1], weight)
    energy[t, 1] = growth
    gradient[t, 1, 0] = ga
    gradient[t, 1, 1] = gb
    aa, ab, bb = area_hessian(a, b, da, db, measure[t][1], weight, True)
    curvature[t, 1, 0, 0] = aa
    curvature[t, 1, 0, 1] = ab
    curvature[t, 1, 1, 0] = wp.transpose(ab)
    curvature[t, 1, 1, 1] = bb
    e, va, vb, vc = volume_term(a, b, c, da, db, dc, measure[t][2], weight)
    energy[t, 2] = e
    gradient[t, 2, 0] = va
    gradient[t, 2, 1] = vb
    gradient[t, 2, 2] = vc


def length(edges: np.ndarray) -> np.ndarray:
    return np.linalg.norm(edges[:, 0], axis=1)


def area(edges: np.ndarray) -> np.ndarray:
    return 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)


def volume(edges: np.ndarray) -> np.ndarray:
    return np.linalg.det(edges) / 6.0


def evaluate(rest: np.ndarray, now: np.ndarray) -> list[np.ndarray]:
    """Of all terms, from edge vectors (cases, 3, 3); those that a term does not have are any."""
    n = len(rest)
    made: Any = {"device": "cpu"}
    measures = np.column_stack([length(rest), area(rest), volume(rest)])
    inputs = [wp.array(x, dtype=wp.vec3d, **made) for x in (rest, now - rest, measures)]
    outputs: Any = [
        wp.zeros((n, 3), dtype=wp.float64, **made),
        wp.zeros((n, 3, 3), dtype=wp.vec3d, **made),
        wp.zeros((n, 3, 3, 3), dtype=wp.mat33d, **made),
    ]
    wp.launch(terms_kernel, dim=n, inputs=[*inputs, WEIGHT], outputs=outputs, **made)
    return [output.numpy() for output in outputs]


class Term:
    """A term of a feature given by its edge vectors from one corner, shape (cases, vectors, 3)."""

    def __init__(self, number: int) -> None:
        self.number, self.vectors = number, number + 1

    def __call__(self, rest: np.ndarray, now: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Energies and gradients."""
        energy, gradient, _ = evaluate(self._filled(rest), self._filled(now))
        return energy[:, self.number], gradient[:, self.number, : self.vectors]

    def curvature(self, rest: np.ndarray, now: np.ndarray) -> np.ndarray:
        """Second derivatives, shape (cases, 3 vectors, 3 vectors)."""
        n = self.vectors
        blocks = evaluate(self._filled(rest), self._filled(now))[2][:, self.number, :n, :n]
        return blocks.transpose(0, 1, 3, 2, 4).reshape(len(rest), 3 * n, 3 * n)

    def _filled(self, edges: np.ndarray) -> np.ndarray:
        """With vectors that the term does not read."""
        return np.concatenate(
            [edges, np.broadcast_to(np.eye(3)[self.vectors :], (len(edges), 3 - self.vectors, 3))], 1
        )


TERMS = {"distance": Term(0), "area": Term(1), "volume": Term(2)}


def rest_edges(term: Term, size: float = 1.0, cases: int = 40) -> np.ndarray:
    """Edge vectors of well-shaped random features, of positive volume."""
    noise = np.random.default_rng(2).normal(scale=0.2, size=(cases, 3, 3))
    turns = np.stack([rotation(37.0 * n, (1.0, n, -n * n)) for n in range(cases)])
    return size * ((np.eye(3) + noise) @ turns)[:, : term.vectors]


def states(term: Term, size: float = 1.0) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Rest and present edge vectors: at rest, random, stretched, compressed, inverted."""
    rest = rest_edges(term, size)
    noise = size * np.random.default_rng(3).normal(scale=0.3, size=rest.shape)
    mirror = np.diag([1.0, 1.0, -1.0])
    return {
        "rest": (rest, rest),
        "random": (rest, rest + noise),
        "stretched": (rest, 1.8 * rest + 0.2 * noise),
        "compressed": (rest, 0.4 * rest + 0.1 * noise),
        "inverted": (rest, rest @ mirror + 0.1 * noise),
    }


def differences(values: Callable[[np.ndarray], np.ndarray], at: np.ndarray, step: float) -> np.ndarray:
    """Central differences of values (cases, ...) in every component of `at`, (cases, vectors * 3, ...)."""
    moves = step * np.eye(at[0].size).reshape(-1, *at[0].shape)
    return np.stack([(values(at + move) - values(at - move)) / (2.0 * step) for move in moves], axis=1)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", TERMS)
def test_gradient_is_that_of_the_energy(name: str, size: float) -> None:
    term = TERMS[name]
    for state, (rest, now) in states(term, size).items():
        numeric = differences(lambda x, rest=rest: term(rest, x)[0], now, 1e-5 * size)
        analytic = term(rest, now)[1].reshape(numeric.shape)
        np.testing.assert_allclose(analytic * size, numeric * size, rtol=2e-8, atol=2e-8, err_msg=state)


def test_volume_force_keeps_float64() -> None:
    """A grown right-angled corner: V = 8 V0, dE/da = 2 w (8 - 1) / V0 * (b x c) / 6."""
    rest = np.eye(3)[None]
    _, gradient = TERMS["volume"](rest, 2.0 * rest)
    np.testing.assert_allclose(gradient[0], np.eye(3) * (2.0 * WEIGHT * 7.0 / (1.0 / 6.0) * 4.0 / 6.0), rtol=1e-15)


def numeric_curvature(term: Term, rest: np.ndarray, now: np.ndarray, size: float = 1.0) -> np.ndarray:
    return differences(lambda x: term(rest, x)[1].reshape(len(rest), -1), now, 1e-5 * size)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(("name", "state"), [("distance", "rest"), ("area", "rest"), ("distance", "stretched")])
def test_curvature_is_exact_at_rest_and_of_a_stretched_edge(name: str, state: str, size: float) -> None:
    term = TERMS[name]
    rest, now = states(term, size)[state]
    numeric = numeric_curvature(term, rest, now, size)
    np.testing.assert_allclose(term.curvature(rest, now) * size**2, numeric * size**2, rtol=1e-6, atol=1e-8)


def test_curvature_of_a_compressed_edge_is_exact_along_it() -> None:
    term = TERMS["distance"]
    rest, now = states(term)["compressed"]
    axis = now[:, 0] / length(now)[:, None]
    numeric = numeric_curvature(term, rest, now)
    analytic = term.curvature(rest, now)
    along = np.einsum("ti,tij,tj->t", axis, numeric, axis)
    np.testing.assert_allclose(np.einsum("ti,tij,tj->t", axis, analytic, axis), along, rtol=1e-6)
    np.testing.assert_allclose(analytic @ axis[:, :, None], along[:, None, None] * axis[:, :, None], rtol=1e-6)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", CURVED)
def test_curvature_is_positive_semidefinite_everywhere(name: str, size: float) -> None:
    term = TERMS[name]
    for state, (rest, now) in states(term, size).items():
        curvature = term.curvature(rest, now)
        np.testing.assert_allclose(curvature, curvature.transpose(0, 2, 1), rtol=1e-13, atol=1e-13 / size**2)
        values = np.linalg.eigvalsh(curvature)
        assert values.min() >= -1e-12 * values.max(), state
        assert (values.max(axis=1) > 0.0).all(), state


def test_values_by_hand() -> None:
    """A 2 mm edge grown to 3 mm, half its length; a 3-4-5 face doubled one way; a corner grown to 2 x 3 x 4."""
    edge = np.array([[[2.0, 0.0, 0.0]]])
    assert TERMS["distance"](edge, np.array([[[0.0, 0.0, 3.0]]]))[0][0] == pytest.approx(WEIGHT * 0.25, rel=1e-15)
    face = np.array([[[3.0, 0.0, 0.0], [0.0, 4.0, 0.0]]])
    grown = np.array([[[0.0, 6.0, 0.0], [0.0, 1.0, 4.0]]])
    assert TERMS["area"](face, grown)[0][0] == pytest.approx(WEIGHT * 1.0, rel=1e-15)
    corner = np.eye(3)[None]
    assert TERMS["volume"](corner, corner * [2.0, 3.0, 4.0])[0][0] == pytest.approx(WEIGHT * 23.0**2, rel=1e-15)
    assert TERMS["volume"](corner, -corner)[0][0] == pytest.approx(WEIGHT * 4.0, rel=1e-15)
    assert TERMS["volume"](corner, corner * [1.0, 1.0, 0.0])[0][0] == pytest.approx(WEIGHT, rel=1e-15)  # flat


def test_collapsed_features_stay_finite() -> None:
    """An edge, a face and a tetrahedron without any size, a flat one, and a sliver at rest."""
    for name, term in TERMS.items():
        rest = rest_edges(term, cases=4)
        flat = rest * [1.0, 1.0, 0.0]
        in_line = np.repeat(rest[:, :1], term.vectors, axis=1)
        for now in (np.zeros_like(rest), flat, in_line):
            for values in term(rest, now):
                assert np.isfinite(values).all(), name
        sliver = rest * [1.0, 1.0, 1e-9] if name == "volume" else rest
        energy, gradient = term(sliver, sliver * 1.01)
        assert np.isfinite(energy).all()
        assert np.isfinite(gradient).all()
        expected = {"distance": 0.01, "area": 1.01**2 - 1.0, "volume": 1.01**3 - 1.0}[name]
        np.testing.assert_allclose(energy, WEIGHT * expected**2, rtol=1e-6)
