"""The inverse of the matrix on the coarsest grid, which is dense."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import warp as wp

from warp_trunk.kernels.multigrid import KEPT, OCTET, STRIP, WHOLE, cpu_grid_kernels

from .model import Model
from .parallel import Launch, view

SHIFT, IDLE_SHIFT = 1e-6, 1e-3
"""Addition to a unit diagonal; and where a grid has vertices with next to no nodes, whose directions, 1e6
times as soft as others, would leave 16 bits with no digits for the others."""


def invert(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric positive semidefinite matrix, (n, n) float64, its flat directions kept finite.

    It is scaled to a unit diagonal and shifted, so that a grid vertex that hardly reaches a node is harmless.
    Numbers below the diagonal are not read."""
    diagonal = np.diagonal(matrix)
    scale = 1.0 / np.sqrt(np.maximum(diagonal, 1e-300))
    scale[diagonal <= 1e-12 * diagonal.max(initial=0.0)] = 0.0
    scaled = matrix * scale
    scaled *= scale[:, None]
    for shift in (SHIFT, IDLE_SHIFT - SHIFT):
        scaled[np.diag_indices(len(scaled))] += shift
        inverse = invert_layers(scaled)
        if np.diagonal(inverse)[scale > 0.0].max(initial=0.0) <= 1.0 / IDLE_SHIFT:
            break
    inverse *= scale
    inverse *= scale[:, None]
    return inverse


def invert_layers(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric positive definite matrix, (n, n) float64, from what is on and above its diagonal.

    Where layers of a grid follow each other it is a block tridiagonal matrix: layers are eliminated one after the
    other, and the inverse is filled in from the last one back (Meurant 1992). On the anatomy that takes an eighth
    of the time of NumPy's inverse. A matrix without zeros is one layer."""
    size = len(matrix)
    last = np.maximum.accumulate(size - 1 - (matrix[:, ::-1] != 0.0).argmax(axis=1))  # column that a row reaches
    bounds = [0]
    while bounds[-1] < size:
        bounds.append(int(last[bounds[-1]]) + 1)
    layers = [slice(first, end) for first, end in pairwise(bounds)]
    inverse = np.zeros_like(matrix)
    carried = []
    pivot = _mirrored(matrix[layers[0], layers[0]])
    for layer, following in pairwise(layers):
        inverse[layer, layer] = np.linalg.inv(pivot)
        across = matrix[layer, following]
        carried.append(inverse[layer, layer] @ across)
        pivot = _mirrored(matrix[following, following]) - across.T @ carried[-1]
    inverse[layers[-1], layers[-1]] = _mirrored(np.linalg.inv(pivot))
    for layer, following, across in zip(layers[-2::-1], layers[:0:-1], carried[::-1], strict=True):
        beyond = slice(layer.stop, size)
        inverse[layer, beyond] = -across @ inverse[following, beyond]
        inverse[beyond, layer] = inverse[layer, beyond].T
        inverse[layer, layer] = _mirrored(inverse[layer, layer] - inverse[layer, following] @ across.T)
    return inverse


def _mirrored(matrix: np.ndarray) -> np.ndarray:
    """The symmetric matrix with the same numbers on and above its diagonal."""
    return np.triu(matrix) + np.triu(matrix, 1).T


def with_unit_diagonal(inverse: np.ndarray, one: float) -> tuple[np.ndarray, np.ndarray]:
    """A and s of a symmetric positive matrix S A S, (n, n) and (n,); in A, `one` stands for 1; see `KEPT`."""
    root = np.sqrt(np.maximum(np.diagonal(inverse), np.finfo(np.float32).tiny))
    numbers = inverse * (KEPT * one / root)[:, None] / root
    np.fill_diagonal(numbers, one)
    return numbers, root / math.sqrt(one)


def in_half_precision(inverse: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same as float16, which none of its numbers overflows, its rows filled up to whole octets."""
    numbers, scale = with_unit_diagonal(inverse, 1.0)
    return np.pad(numbers.astype(np.float16), ((0, 0), (0, -len(numbers) % OCTET))), scale


class DenseProduct:
    """The product with the inverse on the CPU.

    Of S A S, with ones on the diagonal of A, it keeps A in parts of WHOLE, in 16 bits: a preconditioner needs no
    more digits, and the product is limited by the reading of the matrix.
    """

    strips: int
    """The number of strips of STRIP rows."""
    numbers: wp.array
    """A strip after strip, each column after column, int16."""

    def __init__(self, model: Model, inverse: np.ndarray) -> None:
        """Uploads the inverse, shape (n, n)."""
        self._model, self._size = model, len(inverse)
        self.strips = -(-self._size // STRIP)
        numbers, scale = with_unit_diagonal(inverse, WHOLE)
        unused = 0, STRIP * self.strips - self._size
        numbers, scale = np.pad(np.rint(numbers).astype(np.int16), (unused, (0, 0))), np.pad(scale, unused)
        numbers = numbers.reshape(-1, STRIP, self._size).transpose(0, 2, 1)
        self.numbers, self._scale = model.array(numbers.ravel(), wp.int16), model.array(scale, model.scalar)

    def record(self, residual: wp.array, solution: wp.array, iteration: wp.array, bounds: np.ndarray) -> Launch:
        """Records the product, and the counting of the iteration, for bounds of the ranges of strips.

        Both vectors are of shape (n / 3 + STRIP,), vec3, of which n / 3 count."""
        model = self._model
        x, y = (view(vectors, model.scalar, 3 * len(vectors)) for vectors in (residual, solution))
        given = [self._size, self.numbers, self._scale, x]
        return model.parallel.record(cpu_grid_kernels(model.scalar).dense, bounds, given, [y, iteration])
