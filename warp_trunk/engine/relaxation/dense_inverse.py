"""The coarsest level of the preconditioner: the product with a dense inverse."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from warp_trunk.kernels.column_products import column_product_kernels
from warp_trunk.kernels.multilevel import STRIP, multilevel_kernels

from ..model import Model
from ..parallel import Launch, in_turn, view
from .columns import Columns

SMALL = 128
"""A matrix is halved as long as its halves have so many rows."""
BLOCKS = 32
"""Blocks of a row that one CUDA thread adds up for several columns."""


def dense_strips(model: Model, inverse: np.ndarray) -> wp.array:
    """A matrix (3 n, 3 n) for products on the CPU, shape (strips, 3 n), of STRIP rows each."""
    size = len(inverse)
    padded = np.zeros((-(-size // STRIP) * STRIP, size), dtype=inverse.dtype)
    padded[:size] = inverse
    vector: Any = wp.types.vector(STRIP, model.scalar)
    return model.array(padded.reshape(-1, STRIP, size).transpose(0, 2, 1), vector)


def record_dense_product(model: Model, inverse: wp.array, residual: wp.array, solution: wp.array) -> Launch:
    """Records solution = inverse residual, on the CPU.

    Args:
        model: where it runs.
        inverse: symmetric, of n nodes, in `dense_strips`.
        residual: shape (n,), vec3.
        solution: shape (n + STRIP,), vec3: the last strip is written whole.
    """
    strips, size = inverse.shape
    return model.parallel.record(
        multilevel_kernels(model.scalar).dense_strip,
        strips,
        [size, inverse, view(residual, model.scalar, size)],
        [view(solution, inverse.dtype, strips)],
        least=16,
    )


def record_dense_columns(columns: Columns, inverse: np.ndarray, residual: wp.array, solution: wp.array) -> Launch:
    """Records the same for fields of n nodes."""
    model, nodes = columns.model, len(inverse) // 3
    blocks = inverse.reshape(nodes, 3, nodes, 3).transpose(0, 2, 1, 3)
    chunk = BLOCKS if model.parallel.is_cuda else nodes
    product = columns.over(
        column_product_kernels(*columns.variant).multiply_dense,
        nodes * -(-nodes // chunk) * columns.groups,
        [columns.groups, chunk, model.array(blocks, wp.types.matrix((3, 3), model.scalar)), residual],
        [solution],
    )
    return in_turn(model.parallel.once(solution.zero_), product)


def invert(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric positive semidefinite matrix, (n, n) float64, its flat directions held.

    Scaled to a unit diagonal and shifted, so that a grid vertex that hardly reaches a node is harmless.
    """
    diagonal = np.diagonal(matrix)
    scale = 1.0 / np.sqrt(np.maximum(diagonal, 1e-300))
    scale[diagonal <= 1e-12 * diagonal.max(initial=0.0)] = 0.0
    scaled = scale[:, None] * matrix * scale
    scaled[np.diag_indices(len(scaled))] += 1e-6
    inverse = _by_halves(scaled)
    return scale[:, None] * (0.5 * (inverse + inverse.T)) * scale


def _by_halves(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric positive definite matrix by Schur complements: products, half of what LU takes."""
    half = len(matrix) // 2
    if half < SMALL:
        return np.linalg.inv(matrix)
    first = _by_halves(matrix[:half, :half])
    carried = first @ matrix[:half, half:]
    second = _by_halves(matrix[half:, half:] - matrix[half:, :half] @ carried)
    inverse = np.empty_like(matrix)
    inverse[half:, half:] = second
    inverse[:half, half:] = -carried @ second
    inverse[half:, :half] = inverse[:half, half:].T
    inverse[:half, :half] = first - inverse[:half, half:] @ carried.T
    return inverse
