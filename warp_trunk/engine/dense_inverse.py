"""The inverse of the matrix on the coarsest grid, which is dense."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import warp as wp

from warp_trunk.kernels.multigrid import DAMPING, OCTET, STRIP, WHOLE, cpu_grid_kernels

from .model import Model
from .parallel import Launch

SHIFT, IDLE_SHIFT = 1e-6, 1e-3
"""Addition to a unit diagonal; and where a grid has vertices with next to no nodes, whose directions, 1e6
times as soft as others, would leave 16 bits with no digits for the others."""


@dataclass(frozen=True, eq=False)
class DenseInverse:
    """A symmetric positive matrix S A S, with ones on the diagonal of A, in 16 bits.

    A preconditioner needs no more digits, and a product is limited by the reading of the matrix.
    """

    numbers: np.ndarray
    """A in parts of WHOLE, what is off its diagonal times DAMPING, shape (n, n), int16."""
    scale: np.ndarray
    """The diagonal of S, shape (n,)."""

    def in_half_precision(self) -> np.ndarray:
        """A as float16, its rows filled up to whole octets."""
        numbers = (self.numbers / np.float32(WHOLE)).astype(np.float16)
        return np.pad(numbers, ((0, 0), (0, -len(numbers) % OCTET)))


def invert(matrix: np.ndarray) -> DenseInverse:
    """Inverse of a symmetric positive semidefinite matrix, (n, n) float64, its flat directions kept finite.

    It is scaled to a unit diagonal and shifted, so that a grid vertex that hardly reaches a node is harmless.
    Numbers below the diagonal are zero or those above it."""
    diagonal = np.diagonal(matrix)
    scale = 1.0 / np.sqrt(np.maximum(diagonal, 1e-300))
    scale[diagonal <= 1e-12 * diagonal.max(initial=0.0)] = 0.0
    numbers, root = np.empty(matrix.shape, dtype=np.int16), np.empty(len(matrix))
    for shift in (SHIFT, IDLE_SHIFT):
        for layer, rows in inverse_rows(matrix, scale, shift):
            root[layer] = np.sqrt(np.diagonal(rows))
            unit = rows * (DAMPING * WHOLE / root[layer])[:, None]
            unit *= 1.0 / root[layer.start :]
            numbers[layer, layer.start :] = np.rint(unit, out=unit)
            numbers[layer.stop :, layer] = numbers[layer, layer.stop :].T
        if root[scale > 0.0].max(initial=0.0) <= IDLE_SHIFT**-0.5:
            break
    np.fill_diagonal(numbers, WHOLE)
    return DenseInverse(numbers, scale * root)


def inverse_rows(matrix: np.ndarray, scale: np.ndarray, shift: float) -> Iterator[tuple[slice, np.ndarray]]:
    """Inverse of S M S + shift, M as for `invert` and S of diagonal `scale`, from the last rows to the first.

    Where layers of a grid follow each other M is a block tridiagonal matrix: layers are eliminated one after the
    other, and the inverse is filled in from the last one back (Meurant 1992). On the anatomy that takes an eighth
    of the time of NumPy's inverse. A matrix without zeros is one layer.

    Yields:
        A layer, and its rows of the inverse from their first number on the diagonal to the last.
    """
    size = len(matrix)
    last = np.maximum.accumulate(size - 1 - (matrix[:, ::-1] != 0.0).argmax(axis=1))  # column that a row reaches
    bounds = [0]
    while bounds[-1] < size:
        bounds.append(int(last[bounds[-1]]) + 1)
    layers = [slice(first, end) for first, end in pairwise(bounds)]

    def block(rows: slice, other: slice) -> np.ndarray:
        return scale[rows, None] * matrix[rows, other] * scale[other]

    def on_diagonal(layer: slice) -> np.ndarray:
        upper = block(layer, layer)
        return np.where(upper, upper, upper.T) + shift * np.eye(len(upper))

    inverses, carried, pivot = [], [], on_diagonal(layers[0])
    for layer, following in pairwise(layers):
        across = block(layer, following)
        inverses.append(np.linalg.inv(pivot))
        carried.append(inverses[-1] @ across)
        pivot = on_diagonal(following) - across.T @ carried[-1]
    rows = np.linalg.inv(pivot)
    yield layers[-1], rows
    for layer, inverse, across in zip(layers[-2::-1], inverses[::-1], carried[::-1], strict=True):
        beyond = -across @ rows
        own = inverse - beyond[:, : across.shape[1]] @ across.T
        rows = np.hstack([0.5 * (own + own.T), beyond])
        yield layer, rows


class DenseProduct:
    """The product with the inverse on the CPU."""

    strips: int
    """The number of strips of STRIP rows."""
    numbers: wp.array
    """A strip after strip, each column after column, int16."""

    def __init__(self, model: Model, inverse: DenseInverse) -> None:
        """Uploads the inverse."""
        self._model, size = model, len(inverse.numbers)
        self.strips = -(-size // STRIP)
        unused = 0, STRIP * self.strips - size
        numbers = np.pad(inverse.numbers, ((0, 0), unused)).reshape(size, self.strips, STRIP)
        self.numbers = model.array(numbers.swapaxes(0, 1).ravel(), wp.int16)
        self._scale = model.array(np.pad(inverse.scale / math.sqrt(WHOLE), unused), model.scalar)

    def record(self, residual: wp.array, solution: wp.array, bounds: np.ndarray) -> Launch:
        """Records the product for bounds of the ranges of strips.

        Both vectors are of shape (n / 3 + STRIP,), vec3, of which n / 3 count."""
        kernel, inputs = cpu_grid_kernels(self._model.scalar).dense, [self.numbers, self._scale, residual]
        return self._model.parallel.record(kernel, bounds, inputs, [solution])
