"""The preconditioner: 3x3 diagonal blocks on the nodes and on nested grids, a dense inverse on the coarsest.

z = D^-1 r + P_1 (w D_1^-1 + P_2 (w D_2^-1 + ... (P^T H P)^-1 ... ) P_2^T) P_1^T r, an additive multilevel method
(Bramble, Pasciak and Xu 1990) whose levels are trilinear on regular grids laid over the trunk; w is 1 by their
number, because levels overlap. D holds the blocks of the nodes, and of groups of nodes that stiff links tie
(`NodeGroups`). A trilinear field is continuous and holds every affine motion, which the long waves
of soft tissue need; on the phantom it takes a third of the iterations of affine motions of separate aggregates.
The grids' matrices are those of the trunk at rest: made once, they serve every increment, step and surgical plan
of a patient."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from warp_trunk.kernels.multigrid import (
    BLOCK_LANES,
    CORNERS,
    FEW_LANES,
    NODE_LANES,
    ROW_LANES,
    STRIP,
    VERTEX_LANES,
    cpu_grid_kernels,
    cuda_grid_kernels,
    grid_matrix_kernels,
    vec8i,
)
from warp_trunk.kernels.node_groups import groups_type
from warp_trunk.kernels.sparse import diagonal_inverter

from .dense_inverse import DenseInverse, DenseProduct, invert
from .grids import Grids, Interpolation, lay_grids
from .linear import BlockMatrix, Iterates, zero_dots
from .model import Model
from .node_groups import NodeGroups
from .parallel import Launch, in_sequence, view
from .topology import equal_parts

MOST_DENSE = 4
"""Threads that add up the matrix on the coarsest grid at most: each needs one of its own, 30 MB on the anatomy."""


class Multigrid:
    """The levels of a trunk on its device, made of its matrix at rest; see `Preconditioner`.

    Of the matrix that is assembled later it has the blocks of nodes and groups, and where asked those of grids.
    """

    grids: Grids
    """Its grids, which also serve where more nodes are free."""
    groups: NodeGroups
    """The nodes that stiff links tie."""

    def __init__(self, matrix: BlockMatrix, grids: Grids | None = None) -> None:
        """Lays the grids over the free nodes at rest and takes the matrix as it is, a projected Hessian, onto
        them.

        Where `grids` are given they reach only the nodes that were free when they were laid: their matrices are
        then those of before, and nodes that were freed later have their own blocks.
        """
        self.model = model = matrix.model
        laid, to_nodes = lay_grids(model.rest[model.free]) if grids is None else grids.reaching(model.free_nodes)
        onto_nodes = [_Interpolation(model, onto) for onto in to_nodes]
        sizes = [onto.vertices for onto in to_nodes]
        inverse = grids.inverse if grids else invert(grid_matrix(matrix, onto_nodes[-1], sizes[-1]))
        self.grids = Grids(laid, to_nodes, inverse)
        self.groups = NodeGroups(matrix)
        bounds = np.cumsum([0, *sizes[-2::-1]])  # of the grids but the last, the coarsest first
        self._grids = model.zeros(wp.types.matrix((3, 3), model.scalar), int(bounds[-1]))
        diagonals = [self._grids[first:end] for first, end in pairwise(bounds.tolist())][::-1]
        self.update: Launch = self.groups.update
        """Sets the blocks of groups to those of the matrix as it is, projected."""
        self.update_grids: Launch = in_sequence(
            *(
                grid_diagonal(matrix, onto, diagonal, 1.0 / len(sizes))
                for onto, diagonal in zip(onto_nodes[:-1], diagonals, strict=True)
            )
        )
        """The same for the diagonal blocks of all grids but the coarsest, until `reset_grids`."""
        self.update()
        self.update_grids()
        self.reset_grids: Launch = partial(wp.copy, self._grids, wp.clone(self._grids))
        """Sets these blocks to those of the trunk at rest."""
        if model.parallel.is_cuda:
            levels = CudaLevels(matrix, to_nodes, self._grids, inverse, self.groups)
        else:
            between = [_Interpolation(model, g.interpolate(finer.positions)) for finer, g in pairwise(laid)]
            levels = CpuLevels(matrix, [onto_nodes[0], *between], diagonals, inverse, self.groups)
        self.apply = levels.apply


class _Interpolation:
    """An interpolation on the device, as the arguments of the kernels that use it."""

    def __init__(self, model: Model, interpolation: Interpolation) -> None:
        vec8: Any = wp.types.vector(8, model.scalar)
        self.by_point = (model.array(interpolation.vertex, vec8i), model.array(interpolation.weight, vec8))
        self._model, self._interpolation, self.vertices = model, interpolation, interpolation.vertices

    def by_vertex(self) -> tuple[wp.array, wp.array, wp.array]:
        """`Interpolation.by_vertex`."""
        model = self._model
        row_start, point, weight = self._interpolation.by_vertex
        return model.array(row_start, wp.int32), model.array(point, wp.int32), model.array(weight, model.scalar)


class CpuLevels:
    """The grids on the CPU: a launch down and one up for each."""

    def __init__(
        self,
        matrix: BlockMatrix,
        grids: Sequence[_Interpolation],
        inverse_diagonals: Sequence[wp.array],
        inverse: DenseInverse,
        groups: NodeGroups,
    ) -> None:
        """Uploads the inverse on the last grid.

        Args:
            matrix: of the trunk.
            grids: the interpolation of each to the next finer one, of the first to the free nodes.
            inverse_diagonals: of all grids but the last, weighted, shape (vertices,), mat33.
            inverse: on the last, of 3 rows a vertex.
            groups: of tied nodes.
        """
        self._matrix, self._grids, self._groups = matrix, grids, groups
        self._inverse_diagonals, self._inverse = inverse_diagonals, DenseProduct(matrix.model, inverse)

    def apply(self, at: Iterates) -> Launch:
        """See `Preconditioner`."""
        matrix, groups, model = self._matrix, self._groups, self._matrix.model
        kernels, record = cpu_grid_kernels(model.scalar), model.parallel.record
        r, z, dots = at.residual, at.preconditioned, at.r_dot_z
        bounds, members = matrix.bounds, groups.arrays
        down: list[Launch] = []
        up: list[Launch] = []
        for grid, diagonal in zip(self._grids, [matrix.inverse_diagonal, *self._inverse_diagonals], strict=True):
            residual, correction = (  # with room for a whole last strip of the dense product
                model.zeros(model.vec3, grid.vertices + STRIP) for _ in range(2)
            )
            by_vertex = grid.by_vertex()
            rows = equal_parts(by_vertex[0].numpy(), len(matrix.bounds) - 1)
            down.append(record(kernels.restrict, rows, [*by_vertex, r], [residual]))
            interpolate = [diagonal, *grid.by_point, correction, members, r]
            up.append(record(kernels.prolong, bounds, interpolate, [z, dots]))
            r, z, dots, bounds = residual, correction, zero_dots(model), matrix.split(grid.vertices)
            members = groups_type(model.scalar)()  # none
        solve = self._inverse.record(r, z, matrix.split(self._inverse.strips))
        correct = groups.correct(at.residual)
        return in_sequence(correct, *down, solve, *up[::-1])


class CudaLevels:
    """The grids on CUDA: all interpolate to the nodes, so that three launches apply them.

    Vertices are numbered through from the coarsest grid on.
    """

    def __init__(
        self,
        matrix: BlockMatrix,
        grids: Sequence[Interpolation],
        inverse_diagonal: wp.array,
        inverse: DenseInverse,
        groups: NodeGroups,
    ) -> None:
        """Uploads what the launches read.

        Args:
            matrix: of the trunk.
            grids: the interpolation of each to the free nodes, finest first.
            inverse_diagonal: of all but the last, which come last but one first, shape (vertices,), mat33.
            inverse: on the last, of 3 rows a vertex.
            groups: of tied nodes.
        """
        self._matrix, self._groups, model = matrix, groups, matrix.model
        coarsest_first = grids[::-1]
        sizes = [grid.vertices for grid in coarsest_first]
        starts = np.cumsum([0, *sizes])
        self._coarsest, self._vertices = sizes[0], int(starts[-1])
        number = wp.uint16 if max(self._vertices, model.free_nodes) <= 1 << 16 else wp.int32
        self._kernels = cuda_grid_kernels(model.scalar, number)
        row_start, point, weight = zip(*(grid.by_vertex for grid in coarsest_first), strict=True)
        rows = np.concatenate([np.diff(start) for start in row_start])
        self._far = sum(
            size for size, points in zip(sizes[1:], point[1:], strict=True) if len(points) >= VERTEX_LANES * size
        )
        self._by_vertex = (
            model.array(np.concatenate([[0], np.cumsum(rows)]), wp.int32),
            model.array(np.concatenate(point), number),
            model.array(np.concatenate(weight).astype(np.float16), wp.float16),
        )
        corners = [grid.vertex.ravel() + start for grid, start in zip(coarsest_first, starts, strict=False)]
        corner_weights = [grid.weight.ravel() for grid in coarsest_first]
        self._by_node = (
            model.array(np.concatenate(corners), number),
            model.array(np.concatenate(corner_weights).astype(np.float16), wp.float16),
        )
        self._inverse_diagonal = inverse_diagonal
        self._scale = model.array(inverse.scale, wp.float32)
        self._inverse = model.array(inverse.in_half_precision(), wp.float16)

    def apply(self, at: Iterates) -> Launch:
        """See `Preconditioner`."""
        matrix, groups, kernels, model = self._matrix, self._groups, self._kernels, self._matrix.model
        record = model.parallel.record
        rows, columns = len(self._scale), self._inverse.shape[1]
        vec4: Any = wp.types.vector(4, model.scalar)
        residual, correction = at.residual_of_four, model.zeros(vec4, self._vertices)
        coarsest_residual = model.zeros(wp.float32, columns)

        scale = view(self._scale, wp.vec3f, self._coarsest)
        by_few = self._vertices - self._coarsest - self._far + len(groups.arrays.group_of)
        grids = [self._coarsest, self._far, *self._by_vertex, self._inverse_diagonal, scale]
        return in_sequence(
            record(
                kernels.restrict,
                self._coarsest * BLOCK_LANES + self._far * VERTEX_LANES + by_few * FEW_LANES,
                [*grids, residual, groups.arrays],
                [view(coarsest_residual, wp.vec3f, self._coarsest), correction],
                block=BLOCK_LANES,
            ),
            record(
                kernels.dense,
                rows * ROW_LANES,
                [self._inverse, self._scale, coarsest_residual],
                [view(correction, model.scalar, 4 * self._vertices)],
            ),
            record(
                kernels.prolong,
                model.free_nodes * NODE_LANES,
                [
                    view(matrix.inverse_diagonal, model.scalar, 9 * model.free_nodes),
                    *self._by_node,
                    correction,
                    groups.arrays,
                    residual,
                ],
                [view(at.preconditioned, model.scalar, 3 * model.free_nodes), at.r_dot_z],
            ),
        )


def grid_diagonal(matrix: BlockMatrix, whole: _Interpolation, inverse: wp.array, weight: float) -> Launch:
    """Records the inverse diagonal blocks of P^T H P times a weight, for P from a grid's vertices to the nodes."""
    model, size = matrix.model, len(inverse)
    diagonal = model.zeros(inverse.dtype, model.parallel.ranges, size)
    inputs = [matrix.row_start, matrix.columns, matrix.blocks, *whole.by_point]
    own, lanes = model.array(np.arange(size, dtype=np.int32), wp.int32), CORNERS if model.parallel.is_cuda else 1
    return in_sequence(
        model.parallel.clear(diagonal),
        model.parallel.record(
            grid_matrix_kernels(model.scalar, lanes).grid_diagonal, lanes * model.free_nodes, inputs, [diagonal]
        ),
        model.parallel.gather(diagonal, model.scalar),
        model.parallel.record(
            diagonal_inverter(model.scalar), size, [own, diagonal[0], model.scalar(weight)], [inverse]
        ),
    )


def grid_matrix(matrix: BlockMatrix, whole: _Interpolation, size: int) -> np.ndarray:
    """P^T H P, dense, shape (3 size, 3 size), float64; below the diagonal blocks it is zero."""
    model = matrix.model
    ranges = min(model.parallel.ranges, MOST_DENSE)
    untouched = np.zeros((ranges, 3 * size, 3 * size))  # where nothing is added it takes no memory
    dense = wp.array(untouched, dtype=wp.float64, device=model.device, copy=False)
    model.parallel.record(
        grid_matrix_kernels(model.scalar, 1).grid_matrix,
        np.linspace(0, model.free_nodes, ranges + 1),
        [matrix.row_start, matrix.columns, matrix.blocks, *whole.by_point],
        [dense],
    )()
    total, *products = dense.numpy()
    for other in products:
        total += other
    return total
