"""The inverse of the coarsest grid's matrix."""

import numpy as np
import pytest

from warp_trunk.engine.relaxation.dense_inverse import SMALL, invert


def definite(size: int) -> np.ndarray:
    """A stiffness of springs between random pairs and to the ground, over one decade."""
    random = np.random.default_rng(size)
    pairs = random.normal(size=(3 * size, size)) * 10.0 ** random.uniform(-0.5, 0.5, size=(3 * size, 1))
    return pairs.T @ pairs


@pytest.mark.parametrize("size", [1, 3, 2 * SMALL - 1, 2 * SMALL, 4 * SMALL + 3, 5 * SMALL + 7])
def test_it_undoes_the_matrix(size: int) -> None:
    matrix = definite(size)
    found = invert(matrix)
    np.testing.assert_allclose(found, found.T, rtol=1e-12)
    np.testing.assert_allclose(found @ matrix, np.eye(size), atol=1e-4)  # the shift of 1e-6, where it is worst
    right = np.random.default_rng(1).normal(size=size)
    wanted = np.linalg.solve(matrix, right)
    assert np.linalg.norm(found @ right - wanted) < 1e-3 * np.linalg.norm(wanted)


def test_a_vertex_that_reaches_no_node_stays() -> None:
    size, alone = 3 * SMALL, np.array([0, 5, 2 * SMALL])
    matrix = definite(size)
    matrix[alone] = matrix[:, alone] = 0.0
    found = invert(matrix)
    assert not found[alone].any()
    assert not found[:, alone].any()
    others = np.setdiff1d(np.arange(size), alone)
    product = (found @ matrix)[np.ix_(others, others)]
    np.testing.assert_allclose(product, np.eye(len(others)), atol=1e-4)


def layered(size: int, layer: int) -> np.ndarray:
    """A stiffness that couples neighbouring layers alone."""
    matrix = definite(size)
    number = np.arange(size) // layer
    matrix[np.abs(number[:, None] - number) > 1] = 0.0
    matrix[np.diag_indices(size)] += np.abs(matrix).sum(axis=1)  # stays definite
    return matrix


def test_what_is_not_coupled_is_left_out() -> None:
    matrix = layered(5 * SMALL + 7, SMALL // 2)
    np.testing.assert_allclose(invert(matrix) @ matrix, np.eye(len(matrix)), atol=1e-5)


def test_what_is_below_the_diagonal_is_not_read() -> None:
    matrix = layered(5 * SMALL + 7, SMALL)
    np.testing.assert_array_equal(invert(np.triu(matrix)), invert(matrix))


@pytest.mark.parametrize("softest", [1.0, 1e-3, 1e-7])
def test_float32_is_enough_or_left(softest: float) -> None:
    """A direction so soft that float32 cannot tell what is left of it: the inverse stays definite."""
    size = 5 * SMALL
    matrix = definite(size)
    soft = np.random.default_rng(4).normal(size=size)
    across = np.eye(size) - np.outer(soft, soft) / (soft @ soft)
    matrix = across @ matrix @ across + softest * np.outer(soft, soft)
    found = invert(matrix, "float32")
    assert found.dtype == np.float32
    wanted = invert(matrix)
    assert np.linalg.norm(found - wanted, 2) < 0.02 * np.linalg.norm(wanted, 2)
    assert np.linalg.eigvalsh(found.astype(float)).min() > 0.0
