"""The preconditioner: 3x3 diagonal blocks on the nodes and on nested grids, a dense inverse on the coarsest.

z = D^-1 r + P_1 (w D_1^-1 + P_2 (w D_2^-1 + ... (P^T H P)^-1 ... ) P_2^T) P_1^T r, an additive multilevel
method (Bramble, Pasciak and Xu 1990) whose levels are trilinear on regular grids laid over the trunk; w is 1 by
their number, for levels overlap. A trilinear field is continuous and holds every affine motion, which the long
waves of soft tissue need; on the phantom it takes a third of the iterations of affine motions of separate
aggregates. The grids' matrices are those of the trunk at rest: made once, they serve every increment, step and
surgical plan of a patient.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from warp_trunk.kernels.column_products import column_product_kernels
from warp_trunk.kernels.multilevel import multilevel_kernels, vec8i
from warp_trunk.kernels.row_loops import STRIP, row_loops
from warp_trunk.kernels.slabs import slab_kernels
from warp_trunk.kernels.sparse import sparse_kernels

from ..memo import Arrays, arrays_of
from ..model import Model
from ..parallel import Launch, in_turn
from .all_grids import AllGrids
from .block_matrix import BlockMatrix
from .columns import Columns
from .dense_inverse import Strips, dense_strips, invert, record_dense_columns, record_dense_product
from .dots import Dots
from .grid import CoarseGrid, Interpolation
from .iterates import Iterates

DENSE_CELLS = 480
"""Most cells of the coarsest grid that hold nodes; about as many vertices, three rows of the inverse for each."""
MOST_DENSE = 4
"""Threads that add up the matrix on the coarsest grid at most: each needs one of its own, 30 MB on the anatomy."""
FINEST_SPACING = 1.15
"""No grid is finer than this many mean distances of nodes: below, the nodes' own blocks do the work."""


class Multilevel:
    """The levels of a trunk on its device, made of the matrix as it is now; see `Preconditioner`.

    Of the matrix that holds later it takes the diagonal blocks of the nodes.
    """

    def __init__(self, matrix: BlockMatrix, assemble: Callable[[], None] = lambda: None) -> None:
        """Lays the grids over the free nodes at rest and takes the matrix onto them.

        Args:
            matrix: the matrix at rest.
            assemble: sets it, if that is not done yet; not called where all that is made of it is remembered.
        """
        self.model = model = matrix.model
        self._inverse_diagonal = matrix.inverse_diagonal
        points = model.rest[model.free]
        spacings = _spacings(model, points)
        origin = points.min(axis=0) - 1e-3 * spacings[-1]

        def lay(spacing: float) -> tuple[CoarseGrid, Interpolation]:
            grid, onto = CoarseGrid.around(points, origin, spacing)
            if model.parallel.is_cuda:
                _ = onto.by_vertex  # found here, where other grids are laid meanwhile
            return grid, onto

        with ThreadPoolExecutor(len(spacings)) as pool:  # NumPy lets go of the interpreter lock
            self._grids, onto_nodes = zip(*pool.map(lay, spacings), strict=True)
        self._onto_nodes: Interpolation = onto_nodes[0]

        def find() -> Arrays:
            assemble()
            transfers = [self._onto_finest, *(_Transfer(model, onto) for onto in onto_nodes[1:])]
            return _matrices(matrix, transfers, [len(grid.positions) for grid in self._grids])

        def fits(known: Arrays) -> bool:
            return _are_matrices(known, [len(grid.positions) for grid in self._grids], model.precision)

        found = arrays_of(model.memo, "matrices", find, fits)
        self._inverse = found["inverse"]
        mat33 = wp.types.matrix((3, 3), model.scalar)
        self._diagonals = [model.array(found[f"diagonal_{k}"], mat33) for k in range(len(spacings) - 1)]
        self._all_grids: AllGrids | None = None
        if model.parallel.is_cuda:
            self._all_grids = AllGrids(model, onto_nodes, self._diagonals, self._inverse)

    @cached_property
    def _onto_finest(self) -> _Transfer:
        """How the nodes hang on the finest grid, on the device."""
        return _Transfer(self.model, self._onto_nodes)

    @cached_property
    def _levels(self) -> list[_Level]:
        """The grids, each hanging on the one before."""
        pairs = list(pairwise(self._grids))
        transfers = [_Transfer(self.model, grid.interpolate(finer.positions)) for finer, grid in pairs]
        points = [self.model.free_nodes, *(len(grid.positions) for grid in self._grids)]
        return [
            _Level(*level)
            for level in zip(
                points, points[1:], [self._onto_finest, *transfers], [*self._diagonals, None], strict=False
            )
        ]

    @cached_property
    def _strips(self) -> Strips:
        """The dense inverse for the CPU."""
        return dense_strips(self.model, self._inverse)

    def of(self, matrix: BlockMatrix) -> Multilevel:
        """The same grids for another matrix of this trunk, with vectors of their own."""
        other = copy(self)
        other._inverse_diagonal = matrix.inverse_diagonal
        return other

    def apply(self, r: wp.array, z: wp.array, r_dot_z: Dots) -> Launch:
        """Records z = M^-1 r with r . z, for vectors of the free nodes, shape (free nodes,), vec3."""
        if self._all_grids is not None:
            return self._all_grids.apply(self._inverse_diagonal, r, z, r_dot_z)
        model = self.model
        kernels, record = row_loops(model.scalar), partial(model.parallel.record, loops=True)
        inverse_diagonal, dots = self._inverse_diagonal, r_dot_z
        down: list[Launch] = []
        up: list[Launch] = []
        for level in self._levels:
            residual, correction = (  # with room for a whole last strip of the dense product
                model.zeros(model.vec3, level.vertices + STRIP) for _ in range(2)
            )
            gather = [*level.transfer.by_vertex, r]  # a vertex gathers from tens of points
            down.append(record(kernels.restrict, level.vertices, gather, [residual], least=1024))
            interpolate = [inverse_diagonal, *level.transfer.by_point, correction, r]
            up.append(record(kernels.prolong, level.points, interpolate, [z, dots.iteration, dots.products]))
            inverse_diagonal, dots = level.inverse_diagonal, Dots.unread(model)
            r, z = residual, correction
        return in_turn(*down, record_dense_product(model, self._strips, r, z), *up[::-1])

    def apply_with_steps(self, at: Iterates) -> tuple[Launch, Launch]:
        """Records z = M^-1 r, and the same after a step, on CUDA; see `Preconditioner`."""
        assert self._all_grids is not None
        return self._all_grids.apply_with_steps(self._inverse_diagonal, at)

    def apply_columns(self, columns: Columns, r: wp.array, z: wp.array, r_dot_z: wp.array) -> Launch:
        """Records z = M^-1 r with r . z of each column, for fields of the free nodes; see `Columns`."""
        kernels = column_product_kernels(*columns.variant)
        inverse_diagonal, dots = self._inverse_diagonal, r_dot_z
        down: list[Launch] = []
        up: list[Launch] = []
        for level in self._levels:
            size = level.vertices
            residual, correction = (columns.field(size) for _ in range(2))
            down.append(
                columns.over_groups(kernels.restrict, size, [*level.transfer.by_vertex, r], [residual], stretch=1)
            )
            interpolate = [inverse_diagonal, *level.transfer.by_point, correction, r]
            up.append(columns.over_groups(kernels.prolong, level.points, interpolate, [z, dots]))
            inverse_diagonal, dots = level.inverse_diagonal, columns.products()
            r, z = residual, correction
        return in_turn(*down, record_dense_columns(columns, self._inverse, r, z), *up[::-1])


def _spacings(model: Model, points: np.ndarray) -> list[float]:
    """Spacings of the grids, finest first, each twice the one before [mm]; what takes long may be remembered."""

    def fits(known: Arrays) -> bool:
        extent = np.ptp(points, axis=0).max(initial=1e-6)
        return bool(1e-3 * extent < known["node_distance"] <= known["coarsest"] <= extent)

    found = arrays_of(model.memo, "grids", lambda: find_scales(points), fits)
    spacings = [float(found["coarsest"])]
    while 0.5 * spacings[0] >= FINEST_SPACING * float(found["node_distance"]):
        spacings.insert(0, 0.5 * spacings[0])
    return spacings


def _matrices(matrix: BlockMatrix, transfers: list[_Transfer], sizes: list[int]) -> dict[str, np.ndarray]:
    """The inverse of the matrix on the last grid, in the model's precision; `grid_diagonal` on the others."""
    diagonals = [
        grid_diagonal(matrix, transfer, size, 1.0 / len(sizes)).numpy()
        for transfer, size in zip(transfers[:-1], sizes[:-1], strict=True)
    ]
    inverse = invert(grid_matrix(matrix, transfers[-1], sizes[-1]), matrix.model.precision)
    return {"inverse": inverse, **{f"diagonal_{k}": values for k, values in enumerate(diagonals)}}


def _are_matrices(known: Arrays, sizes: list[int], precision: str) -> bool:
    """Whether these can be `_matrices` of grids with so many vertices."""
    *finer, coarsest = sizes
    shapes = {"inverse": (3 * coarsest,) * 2, **{f"diagonal_{k}": (size, 3, 3) for k, size in enumerate(finer)}}
    return known.keys() == shapes.keys() and all(
        known[name].shape == shape and known[name].dtype == precision and bool(np.isfinite(known[name]).all())
        for name, shape in shapes.items()
    )


class _Transfer:
    """An interpolation on the device, as the arguments of the kernels that use it."""

    def __init__(self, model: Model, interpolation: Interpolation) -> None:
        vec8: Any = wp.types.vector(8, model.scalar)
        self._model, self._interpolation = model, interpolation
        self.by_point = (model.array(interpolation.vertex, vec8i), model.array(interpolation.weight, vec8))

    @cached_property
    def by_vertex(self) -> tuple[wp.array, wp.array, wp.array]:
        """`Interpolation.by_vertex`."""
        model = self._model
        row_start, point, weight = self._interpolation.by_vertex
        return model.array(row_start, wp.int32), model.array(point, wp.int32), model.array(weight, model.scalar)


@dataclass(frozen=True)
class _Level:
    """A grid, and how it hangs on the nodes or the next finer grid, its points."""

    points: int
    """Number of points."""
    vertices: int
    """Number of its vertices."""
    transfer: _Transfer
    """P, from its vertices to the points."""
    inverse_diagonal: wp.array | None
    """D^-1 of its vertices, weighted, shape (vertices,), mat33; None for the coarsest, which is solved densely."""


def grid_diagonal(matrix: BlockMatrix, whole: _Transfer, size: int, weight: float) -> wp.array:
    """Inverse diagonal blocks of P^T H P times a weight, for P from the nodes to `size` vertices."""
    model = matrix.model
    mat33 = wp.types.matrix((3, 3), model.scalar)
    diagonal = model.zeros(mat33, model.parallel.ranges, size)
    sparsity, slabs = matrix.sparsity, slab_kernels(mat33)
    model.over_free(
        multilevel_kernels(model.scalar).grid_diagonal,
        [sparsity.row_start, sparsity.columns, matrix.blocks, *whole.by_point],
        [diagonal],
    )()
    model.parallel.record(slabs.gather, size, [model.parallel.ranges], [diagonal])()
    inverse = model.zeros(mat33, size)
    own = model.array(np.arange(size, dtype=np.int32), wp.int32)
    model.parallel.record(
        sparse_kernels(model.scalar).invert_diagonal, size, [own, diagonal, model.scalar(weight)], [inverse]
    )()
    return inverse


def grid_matrix(matrix: BlockMatrix, whole: _Transfer, size: int) -> np.ndarray:
    """P^T H P, dense, shape (3 size, 3 size), float64; below the diagonal blocks it is zero."""
    model, sparsity = matrix.model, matrix.sparsity
    ranges = min(model.parallel.ranges, MOST_DENSE)
    dense = model.zeros(wp.float64, ranges, 3 * size, 3 * size)
    model.parallel.record(
        multilevel_kernels(model.scalar).grid_matrix,
        np.linspace(0, model.free_nodes, ranges + 1).astype(np.int64),
        [sparsity.row_start, sparsity.columns, matrix.blocks, *whole.by_point],
        [dense],
    )()
    total, *others = dense.numpy()
    for other in others:
        total += other
    return total


def find_scales(points: np.ndarray) -> dict[str, np.ndarray]:
    """The spacing of the coarsest grid and the mean distance of nodes [mm]."""
    dense = float(np.ptp(points, axis=0).max(initial=1e-6))
    most = min(DENSE_CELLS, len(points) / 8)
    along = np.ascontiguousarray((points - points.min(axis=0)).T)
    while occupied_cells(along, dense / 1.1) <= most:
        dense /= 1.1
    quarter = 0.25 * dense
    node_distance = quarter * (occupied_cells(along, quarter) / len(points)) ** (1.0 / 3.0)
    return {"coarsest": np.array(dense), "node_distance": np.array(node_distance)}


def occupied_cells(along: np.ndarray, spacing: float) -> int:
    """Number of cells of a regular grid that hold a point, by its distance along each axis, (3, points)."""
    cells = (along / spacing).astype(np.int64)
    size = cells.max(axis=1) + 1
    occupied = np.zeros(size.prod(), dtype=bool)
    occupied[(cells[0] * size[1] + cells[1]) * size[2] + cells[2]] = True
    return int(np.count_nonzero(occupied))
