"""The inverse of the coarsest grid's matrix."""

import numpy as np
from warp_trunk.kernels.multigrid import DAMPING, WHOLE

from warp_trunk.engine.dense_inverse import IDLE_SHIFT, DenseInverse, invert


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


def in_16_bits(matrix: np.ndarray) -> DenseInverse:
    """A positive matrix as if it were the inverse of another."""
    root = np.sqrt(np.diagonal(matrix))
    numbers = np.rint(DAMPING * WHOLE * matrix / root[:, None] / root).astype(np.int16)
    np.fill_diagonal(numbers, WHOLE)
    return DenseInverse(numbers, root)


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
