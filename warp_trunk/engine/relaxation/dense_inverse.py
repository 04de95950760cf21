"""The coarsest level of the preconditioner: the product with a dense inverse."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import warp as wp

from warp_trunk.kernels.column_products import column_product_kernels
from warp_trunk.kernels.multilevel import KEPT
from warp_trunk.kernels.row_loops import STRIP, WHOLE, row_loops

from ..model import Model
from ..parallel import Launch, in_turn, view
from .columns import Columns

SMALL = 64
"""A matrix is halved as long as its halves have so many rows."""
FLAT = 10.0
"""In float32 the trace of an inverse is at most so many times that of the matrix, which has a unit diagonal. The
smallest eigenvalue is then at least a part of 10 n, so that rounding spoils a hundredth of its direction."""
HELD, IDLE_HELD = 1e-6, 1e-3
"""What is added to a unit diagonal; and where a grid has vertices with next to no nodes, whose directions, 1e6
times as soft as others, would leave to these none of 16 bits."""
BLOCKS = 32
"""Blocks of a row that one CUDA thread adds up for several columns."""


@dataclass(frozen=True, eq=False)
class Strips:
    """A symmetric positive matrix for products on the CPU: S A S, A in 16 bits with ones on its diagonal."""

    numbers: wp.array
    """A in parts of WHOLE: strip after strip of STRIP rows, each column after column, shape (numbers,), int16."""
    scale: wp.array
    """The diagonal of S, shape (STRIP strips,), and 0 where there is no row; numbers count in units of WHOLE."""
    columns: int
    """Of the matrix, filled up to an even number."""

    @property
    def strips(self) -> int:
        """Their number."""
        return len(self.scale) // STRIP


def dense_strips(model: Model, matrix: np.ndarray) -> Strips:
    """A matrix (n, n) for products on the CPU; of a preconditioner, which needs no more digits."""
    size = len(matrix)
    rows, columns = -(-size // STRIP) * STRIP, size + size % 2
    root = np.sqrt(np.maximum(np.diagonal(matrix), np.finfo(np.float32).tiny))
    numbers = np.zeros((rows, columns), dtype=np.int16)
    numbers[:size, :size] = np.rint(matrix * (KEPT * WHOLE / root)[:, None] / root)
    np.fill_diagonal(numbers[:size, :size], WHOLE)
    scale = np.zeros(rows)
    scale[:size] = root / math.sqrt(WHOLE)
    strips = numbers.reshape(-1, STRIP, columns).transpose(0, 2, 1)
    return Strips(model.array(strips.ravel(), wp.int16), model.array(scale, model.scalar), columns)


def record_dense_product(model: Model, inverse: Strips, residual: wp.array, solution: wp.array) -> Launch:
    """Records solution = inverse residual, on the CPU; both are of shape (n + STRIP,), vec3, of which n count."""
    return model.parallel.record(
        row_loops(model.scalar).dense,
        inverse.strips,
        [inverse.columns, inverse.numbers, inverse.scale, view(residual, model.scalar, 3 * len(residual))],
        [view(solution, model.scalar, 3 * len(solution))],
        least=16,
        loops=True,
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


def invert(matrix: np.ndarray, precision: str = "float64") -> np.ndarray:
    """Inverse of a symmetric positive semidefinite matrix, (n, n) float64, its flat directions held.

    Scaled to a unit diagonal and shifted, so that a grid vertex that hardly reaches a node is harmless. What is
    below the diagonal is not read. It is found in the precision that is asked for, unless it shows directions so
    flat that float32 would not tell them from others; the anatomy has none of a twentieth of the diagonal.
    """
    diagonal = np.diagonal(matrix)
    scale = 1.0 / np.sqrt(np.maximum(diagonal, 1e-300))
    scale[diagonal <= 1e-12 * diagonal.max(initial=0.0)] = 0.0
    inverse = _of_scaled(matrix, scale, precision, HELD)
    flat = np.diagonal(inverse)[scale > 0.0]
    if precision != "float64" and not (flat.min(initial=1.0) > 0.0 and flat.sum() <= FLAT * len(flat)):
        inverse = _of_scaled(matrix, scale, "float64", HELD)
        flat = np.diagonal(inverse)[scale > 0.0]
    if flat.max(initial=0.0) > 1.0 / IDLE_HELD:
        inverse = _of_scaled(matrix, scale, "float64", IDLE_HELD)
    inverse *= scale.astype(inverse.dtype)
    inverse *= scale[:, None].astype(inverse.dtype)
    return inverse.astype(precision, copy=False)


def _of_scaled(matrix: np.ndarray, scale: np.ndarray, precision: str, held: float) -> np.ndarray:
    """The inverse of the matrix with rows and columns scaled, shifted, in a precision."""
    scaled = np.multiply(matrix, scale, out=np.empty(matrix.shape, precision), casting="same_kind")
    scaled *= scale[:, None].astype(precision)
    scaled[np.diag_indices(len(scaled))] += held
    inverse = np.empty_like(scaled)
    _by_halves(scaled, inverse)
    return inverse


def _by_halves(matrix: np.ndarray, inverse: np.ndarray) -> None:
    """Sets the inverse of a symmetric positive definite matrix, which is spoiled, by Schur complements.

    Of what couples the halves only the rows and columns between the first and the last that are not zero take
    part: those of a grid whose vertices are numbered layer by layer are few.
    """
    half = len(matrix) // 2
    if half < SMALL:
        inverse[:] = np.linalg.inv(np.triu(matrix) + np.triu(matrix, 1).T)
        _mirror(inverse)
        return
    first, across, second = inverse[:half, :half], inverse[:half, half:], inverse[half:, half:]
    coupling = matrix[:half, half:]
    rows, columns = (_span(np.any(coupling, axis=axis, keepdims=True)) for axis in (1, 0))
    coupling = coupling[rows, columns]
    _by_halves(matrix[:half, :half], first)
    carried = first[:, rows] @ coupling
    matrix[half:, half:][columns, columns] -= coupling.T @ carried[rows]
    _by_halves(matrix[half:, half:], second)
    np.matmul(-carried, second[columns], out=across)
    first -= across[:, columns] @ carried.T
    _mirror(inverse)


def _mirror(matrix: np.ndarray) -> None:
    """Sets what is below the diagonal to what is above it, part by part, as the cache holds them."""
    for start in range(0, len(matrix), SMALL):
        part = slice(start, start + SMALL)
        for above in range(0, start, SMALL):
            matrix[part, above : above + SMALL] = matrix[above : above + SMALL, part].T
        own = matrix[part, part]
        own[:] = np.triu(own) + np.triu(own, 1).T


def _span(which: np.ndarray) -> slice:
    """From the first to the last that is true."""
    there = np.flatnonzero(which)
    return slice(int(there[0]), int(there[-1]) + 1) if len(there) else slice(0)
