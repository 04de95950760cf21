"""The coarsest level of the preconditioner: the product with a dense inverse."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from warp_trunk.kernels.multilevel import CHUNK, STRIP, multilevel_kernels

from ..model import Model
from ..parallel import Launch


def record_dense_inverse(model: Model, matrix: np.ndarray, residual: wp.array, solution: wp.array) -> Launch:
    """Records solution = matrix^-1 residual.

    Args:
        model: where it runs.
        matrix: symmetric, positive semidefinite, shape (3 n, 3 n), float64, on the host.
        residual: shape (n,), vec3.
        solution: shape (n + STRIP,), vec3: the last strip is written whole.
    """
    size, inverse = len(matrix), invert(matrix)
    flat_residual = view(residual, model.scalar, size)
    kernels = multilevel_kernels(*model.variant)
    if model.parallel.is_cuda:
        product = model.parallel.record(
            kernels.dense_chunk,
            size * -(-size // CHUNK),
            [size, model.array(inverse, model.scalar), flat_residual],
            [view(solution, model.scalar, size)],
        )

        def solve() -> None:
            solution.zero_()
            product()

        return solve
    strips = -(-size // STRIP)
    padded = np.zeros((strips * STRIP, size))
    padded[:size] = inverse
    by_strip = padded.reshape(strips, STRIP, size).transpose(0, 2, 1)
    vector: Any = wp.types.vector(STRIP, model.scalar)
    return model.parallel.record(
        kernels.dense_strip,
        strips,
        [size, model.array(by_strip, vector), flat_residual],
        [view(solution, vector, strips)],
        least=16,
    )


def view(array: wp.array, dtype: Any, size: int) -> wp.array:
    """The same memory with elements of another type."""
    return wp.array(ptr=array.ptr, shape=(size,), dtype=dtype, device=array.device)


def invert(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric positive semidefinite matrix, (n, n) float64, its flat directions held.

    Scaled to a unit diagonal and shifted, so that a grid vertex that hardly reaches a node is harmless.
    """
    diagonal = np.diagonal(matrix)
    scale = 1.0 / np.sqrt(np.maximum(diagonal, 1e-300))
    scale[diagonal <= 1e-12 * diagonal.max(initial=0.0)] = 0.0
    scaled = scale[:, None] * matrix * scale
    scaled[np.diag_indices(len(scaled))] += 1e-6
    inverse = np.linalg.inv(scaled)
    return scale[:, None] * (0.5 * (inverse + inverse.T)) * scale
