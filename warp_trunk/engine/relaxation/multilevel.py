"""The preconditioner: 3x3 diagonal blocks on the nodes and on nested grids, a dense inverse on the coarsest.

z = D^-1 r + P_1 (w D_1^-1 + P_2 (w D_2^-1 + ... (P^T H P)^-1 ... ) P_2^T) P_1^T r, an additive multilevel
method (Bramble, Pasciak and Xu 1990) whose levels are trilinear on regular grids laid over the trunk. A
trilinear field is continuous and holds every affine motion, which the long waves of soft tissue need; on
the phantom it takes a third of the iterations of affine motions of separate aggregates. The grids' matrices
are those of the trunk at rest: made once, they serve every increment, step and surgical plan of a patient.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from warp_trunk.kernels.multilevel import CHUNK, LANES, STRIP, multilevel_kernels, vec8i
from warp_trunk.kernels.sparse import sparse_kernels

from ..model import Model
from .grid import Grid, Interpolation
from .sparsity import Sparsity

DENSE_CELLS = 480
"""Most cells of the coarsest grid that hold nodes; about as many vertices, three rows of the inverse for each."""
FINEST_SPACING = 1.6
"""No grid is finer than this many mean distances of nodes: below, the nodes' own blocks do the work."""
GRID_WEIGHT = 0.5
"""Factor on the diagonal blocks of the grids between, which overlap with the levels above and below."""


class Multilevel:
    """The levels of a trunk on its device; `apply` preconditions the residual it was made with."""

    def __init__(
        self,
        model: Model,
        sparsity: Sparsity,
        blocks: wp.array,
        inverse_diagonal: wp.array,
        residual: wp.array,
        correction: wp.array,
        iteration: wp.array,
        products: wp.array,
    ) -> None:
        """Builds the levels and records their launches.

        Args:
            model: the trunk.
            sparsity: pattern of the matrix over its free nodes.
            blocks: the matrix at rest, shape (ranges, blocks), mat33.
            inverse_diagonal: D^-1 of the nodes, shape (free,), mat33; may change later.
            residual: r, shape (free,), vec3.
            correction: z, shape (free,), vec3.
            iteration: row of `products` that the first application writes, shape (1,), int32.
            products: r . z by iteration and range, shape (rows, 8 ranges).
        """
        self.model = model
        kernels = multilevel_kernels(*model.variant)
        points = model.rest[: model.free]
        spacings = choose_spacings(points)
        origin = points.min(axis=0) - 1e-3 * spacings[-1]
        unused = (model.array(None, wp.int32, (1,)), 0, model.array(None, wp.float64, (1, products.shape[1])))
        fine: tuple[Any, ...] = (inverse_diagonal, residual, correction)
        outputs: list[tuple[Any, ...]] = [(iteration, 0, products), (iteration, 1, products)]
        self._restrict: list[tuple[wp.array, Callable[[], None]]] = []
        self._prolong: list[list[Callable[[], None]]] = []
        from_points = points
        for spacing in spacings:
            grid = Grid.around(points, origin, spacing)
            transfer = _Transfer(model, grid.interpolate(from_points))
            whole = _Transfer(model, grid.interpolate(points))
            size = len(grid.positions)
            coarse_residual = model.array(None, model.vec3, (size,))
            coarse_correction = model.array(None, model.vec3, (size + STRIP,))  # room for a whole last strip
            lanes = LANES if model.parallel.is_cuda else 1
            gather = model.parallel.record(
                kernels.restrict,
                size * lanes,
                [*transfer.by_vertex, fine[1]],
                [coarse_residual],
                least=1024,  # a vertex gathers from tens of points
            )
            self._restrict.append((coarse_residual, gather))
            diagonal, fine_residual, fine_correction = fine
            self._prolong.append(
                [
                    model.parallel.record(
                        kernels.prolong,
                        len(from_points),
                        [diagonal, *transfer.by_point, coarse_correction, fine_residual],
                        [fine_correction, *output],
                    )
                    for output in outputs
                ]
            )
            last = spacing == spacings[-1]
            inverse = None if last else self._grid_diagonal(sparsity, blocks, whole, size)
            fine = (inverse, coarse_residual, coarse_correction)
            outputs = [unused, unused]
            from_points = grid.positions
            if last:
                self._make_dense(self._grid_matrix(sparsity, blocks, whole, size), *fine[1:])

    def apply(self, ahead: int) -> None:
        """z = M^-1 r; adds r . z to the row of the iteration, or to the next one with `ahead` 1."""
        for coarse_residual, gather in self._restrict:
            if self.model.parallel.is_cuda:
                coarse_residual.zero_()
            gather()
        self._solve_dense()
        for prolong in self._prolong[::-1]:
            prolong[ahead]()

    def _grid_diagonal(self, sparsity: Sparsity, blocks: wp.array, whole: _Transfer, size: int) -> wp.array:
        """Inverse diagonal blocks of P^T H P, weighted."""
        model = self.model
        mat33 = wp.types.matrix((3, 3), model.scalar)
        diagonal = model.array(None, mat33, (1, size))
        wp.launch(
            multilevel_kernels(*model.variant).grid_diagonal,
            dim=model.free,
            inputs=[sparsity.row_start, sparsity.columns, blocks, *whole.by_point],
            outputs=[diagonal[0]],
            device=model.device,
        )
        inverse = model.array(None, mat33, (size,))
        own = model.array(np.arange(size, dtype=np.int32), wp.int32)
        model.parallel.record(
            sparse_kernels(*model.variant).invert_diagonal,
            size,
            [own, diagonal, model.scalar(GRID_WEIGHT)],
            [inverse],
        )()
        return inverse

    def _grid_matrix(self, sparsity: Sparsity, blocks: wp.array, whole: _Transfer, size: int) -> np.ndarray:
        """P^T H P of the coarsest grid, dense, shape (3 size, 3 size), float64."""
        model = self.model
        matrix = wp.zeros((3 * size, 3 * size), dtype=wp.float64, device=model.device)
        wp.launch(
            multilevel_kernels(*model.variant).grid_matrix,
            dim=model.free,
            inputs=[sparsity.row_start, sparsity.columns, blocks, *whole.by_point],
            outputs=[matrix],
            device=model.device,
        )
        return matrix.numpy()

    def _make_dense(self, matrix: np.ndarray, residual: wp.array, solution: wp.array) -> None:
        """Records the product of the dense inverse with the residual of the coarsest grid."""
        model, size = self.model, len(matrix)
        kernels = multilevel_kernels(*model.variant)
        inverse = invert(matrix)
        flat_residual = self._view(residual, model.scalar, size)
        if model.parallel.is_cuda:
            product = model.parallel.record(
                kernels.dense_chunk,
                size * -(-size // CHUNK),
                [size, model.array(inverse, model.scalar), flat_residual],
                [self._view(solution, model.scalar, size)],
            )

            def solve_dense() -> None:
                solution.zero_()
                product()

            self._solve_dense = solve_dense
            return
        strips = -(-size // STRIP)
        padded = np.zeros((strips * STRIP, size))
        padded[:size] = inverse
        by_strip = padded.reshape(strips, STRIP, size).transpose(0, 2, 1)
        vector: Any = wp.types.vector(STRIP, model.scalar)
        self._solve_dense = model.parallel.record(
            kernels.dense_strip,
            strips,
            [size, model.array(by_strip, vector), flat_residual],
            [self._view(solution, vector, strips)],
            least=16,
        )

    def _view(self, array: wp.array, dtype: Any, size: int) -> wp.array:
        """The same memory with elements of another type."""
        return wp.array(ptr=array.ptr, shape=(size,), dtype=dtype, device=self.model.device)


class _Transfer:
    """An interpolation on the device, as the arguments of the kernels that use it."""

    def __init__(self, model: Model, interpolation: Interpolation) -> None:
        vec8: Any = wp.types.vector(8, model.scalar)
        self.by_point = (model.array(interpolation.vertex, vec8i), model.array(interpolation.weight, vec8))
        self.by_vertex = (
            model.array(interpolation.row_start, wp.int32),
            model.array(interpolation.point, wp.int32),
            model.array(interpolation.point_weight, model.scalar),
        )


def choose_spacings(points: np.ndarray) -> list[float]:
    """Spacings of the grids, finest first, each twice the one before [mm]."""
    dense = float(np.ptp(points, axis=0).max(initial=1e-6))
    most = min(DENSE_CELLS, len(points) / 8)
    while occupied_cells(points, dense / 1.1) <= most:
        dense /= 1.1
    quarter = 0.25 * dense
    node_distance = quarter * (occupied_cells(points, quarter) / len(points)) ** (1.0 / 3.0)
    spacings = [dense]
    while 0.5 * spacings[0] >= FINEST_SPACING * node_distance:
        spacings.insert(0, 0.5 * spacings[0])
    return spacings


def occupied_cells(points: np.ndarray, spacing: float) -> int:
    """Number of cells of a regular grid that hold a point."""
    cell = ((points - points.min(axis=0)) / spacing).astype(np.int64)
    occupied = np.zeros(cell.max(axis=0) + 1, dtype=bool)
    occupied[tuple(cell.T)] = True
    return int(occupied.sum())


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
