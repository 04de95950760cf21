"""The inverse of the coarsest grid's matrix."""

import numpy as np
import pytest
from warp_trunk.kernels.multigrid import DAMPING, WHOLE

from support.meshes import block
from support.models import model_of
from warp_trunk.engine.dense_inverse import IDLE_SHIFT, SHIFT, DenseInverse, DenseProduct, inverse_rows, invert
from warp_trunk.engine.rest_mesh import PRECISIONS


def definite(size: int) -> np.ndarray:
    """A stiffness of springs between random pairs and to the ground, over one decade."""
    random = np.random.default_rng(size)
    pairs = random.normal(size=(3 * size, size)) * 10.0 ** random.uniform(-0.5, 0.5, size=(3 * size, 1))
    return pairs.T @ pairs


def dense(inverse: DenseInverse) -> np.ndarray:
    """S A S, without the factor of what is off the diagonal."""
    numbers = inverse.numbers / (DAMPING * WHOLE)
    np.fill_diagonal(numbers, 1.0)
    return inverse.scale[:, None] * numbers * inverse.scale


def collected(matrix: np.ndarray, shift: float) -> np.ndarray:
    """The inverse by `inverse_rows`, without scale."""
    inverse = np.full(matrix.shape, np.nan)
    for layer, rows in inverse_rows(matrix, np.ones(len(matrix)), shift):
        inverse[layer, layer.start :], inverse[layer.start :, layer] = rows, rows.T
    return inverse


def in_16_bits(matrix: np.ndarray) -> DenseInverse:
    """A positive matrix as if it were the inverse of another."""
    root = np.sqrt(np.diagonal(matrix))
    numbers = np.rint(DAMPING * WHOLE * matrix / root[:, None] / root).astype(np.int16)
    np.fill_diagonal(numbers, WHOLE)
    return DenseInverse(numbers, root)


@pytest.mark.parametrize("size", [1, 64, 327])
def test_it_undoes_the_matrix(size: int) -> None:
    matrix = definite(size)
    inverse = invert(matrix)
    np.testing.assert_array_equal(inverse.numbers, inverse.numbers.T)
    np.testing.assert_array_equal(invert(np.triu(matrix)).numbers, inverse.numbers)  # those below are not needed
    wanted = np.linalg.inv(matrix + SHIFT * np.diag(np.diagonal(matrix)))
    root = np.sqrt(np.diagonal(wanted))
    np.testing.assert_allclose(inverse.scale, root, rtol=1e-9)
    np.testing.assert_allclose(
        dense(inverse) / root[:, None] / root, wanted / root[:, None] / root, atol=0.51 / WHOLE
    )


def test_a_vertex_that_reaches_no_node_stays() -> None:
    size, alone = 192, np.array([0, 5, 128])
    matrix = definite(size)
    matrix[alone] = matrix[:, alone] = 0.0
    inverse = dense(invert(matrix))
    assert not inverse[alone].any()
    assert not inverse[:, alone].any()
    reached = np.ix_(*[np.setdiff1d(np.arange(size), alone)] * 2)
    wanted = dense(invert(matrix[reached]))
    np.testing.assert_allclose(inverse[reached], wanted, rtol=0.0, atol=1e-4 * np.diagonal(wanted).max())


@pytest.mark.parametrize("layers", [(40,), (1, 30, 2, 50, 9), (16, 16, 16, 16), (33, 1)])
def test_layers_that_follow_each_other(layers: tuple[int, ...]) -> None:
    """Of different size, each coupled with the next one alone."""
    matrix = definite(sum(layers))
    layer = np.repeat(np.arange(len(layers)), layers)
    matrix[np.abs(layer - layer[:, None]) > 1] = 0.0
    matrix += np.diag(np.abs(matrix).sum(axis=1))
    inverse, wanted = collected(np.triu(matrix), 0.5), np.linalg.inv(matrix + 0.5 * np.eye(len(matrix)))
    np.testing.assert_allclose(inverse, wanted, rtol=0.0, atol=1e-12 * np.abs(wanted).max())


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize(("nodes", "threads"), [(1, 1), (150, 2)])
def test_its_product_in_16_bits(nodes: int, threads: int, precision: str) -> None:
    """Wrong by half of the last bit of each number; rows of different size."""
    model = model_of(block((2, 2, 2)), threads=threads, precision=precision)
    size = np.random.default_rng(nodes).permutation(np.geomspace(0.01, 100.0, 3 * nodes))
    matrix = size[:, None] * definite(3 * nodes) * size
    x = np.random.default_rng(2).normal(size=(nodes + 16, 3))
    solution = model.zeros(model.vec3, nodes + 16)
    product = DenseProduct(model, in_16_bits(matrix))
    for _ in range(2):  # nothing is left of the product before
        bounds = model.parallel.split(product.strips)
        product.record(model.array(x, model.vec3), solution, bounds)()
    rounded, wanted = solution.numpy().ravel()[: 3 * nodes], matrix @ x[:nodes].ravel()
    root = np.sqrt(np.diagonal(matrix))
    most = (0.5 / WHOLE + 1.0 - DAMPING) * root * (root * np.abs(x[:nodes].ravel())).sum()
    assert (np.abs(rounded - wanted) <= 1.1 * most + 1e-5 * np.abs(wanted)).all()
    assert np.abs(rounded - wanted).max() > 0.0
    assert not solution.numpy().ravel()[3 * nodes :].any()


def test_it_stays_positive_in_16_bits() -> None:
    """Of a grid with more vertices than nodes depend on: its largest numbers are those of what moves nothing."""
    grid, nodes = 24, 9
    weights = np.random.default_rng(4).normal(size=(grid, nodes))
    matrix = weights @ np.diag(np.geomspace(1.0, 1e3, nodes)) @ weights.T
    ours = invert(matrix)
    shifted = np.linalg.inv(matrix + IDLE_SHIFT * np.diag(np.diagonal(matrix)))
    np.testing.assert_allclose(ours.scale, np.sqrt(np.diagonal(shifted)), rtol=1e-9)
    inverse = np.linalg.inv(matrix + 1e-6 * np.diag(np.diagonal(matrix)))
    scale = np.sqrt(np.diagonal(inverse))
    assert np.linalg.eigvalsh((inverse / scale[:, None] / scale).astype(np.float16).astype(float))[0] < 0.0
    for each in (ours, in_16_bits(inverse)):
        for numbers in (each.numbers, each.in_half_precision()[:, :grid]):
            assert np.linalg.eigvalsh(numbers.astype(float))[0] > 0.0
