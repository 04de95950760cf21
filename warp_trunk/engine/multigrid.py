"""The preconditioner: 3x3 diagonal blocks on the nodes and on nested grids, a dense inverse on the coarsest.

z = D^-1 r + P_1 (w D_1^-1 + P_2 (w D_2^-1 + ... (P^T H P)^-1 ... ) P_2^T) P_1^T r, an additive multilevel method
(Bramble, Pasciak and Xu 1990) whose levels are trilinear on regular grids laid over the trunk; w is 1 by their
number, because levels overlap. D holds the blocks of the nodes, and of groups of nodes that stiff links tie
(`NodeGroups`). A trilinear field is continuous and holds every affine motion, which the long waves
of soft tissue need; on the phantom it takes a third of the iterations of affine motions of separate aggregates.
The grids' matrices are those of the trunk at rest: made once, they serve every increment, step and surgical plan
of a patient."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from warp_trunk.kernels.multigrid import (
    BLOCK_LANES,
    CORNERS,
    FEW_LANES,
    KEPT,
    NODE_LANES,
    ROW_LANES,
    STRIP,
    VERTEX_LANES,
    WHOLE,
    cpu_grid_kernels,
    cuda_grid_kernels,
    grid_matrix_kernels,
    vec8i,
)
from warp_trunk.kernels.sparse import diagonal_inverter

from .dense_inverse import in_half_precision, invert
from .grids import Grids, Interpolation, lay_grids
from .linear import BlockMatrix, Dots, Iterates
from .model import Model
from .node_groups import NodeGroups
from .parallel import Launch, in_sequence, view
from .topology import equal_parts

MOST_DENSE = 4
"""Threads that add up the matrix on the coarsest grid at most: each needs one of its own, 30 MB on the anatomy."""


class Multigrid:
    """The levels of a trunk on its device, made of the matrix at rest; see `Preconditioner`.

    Of the matrix that is assembled later it has the blocks of nodes and groups, and where asked those of grids.
    """

    grids: Grids
    """Its grids, which also serve where more nodes are free."""

    def __init__(self, matrix: BlockMatrix, grids: Grids | None = None) -> None:
        """Lays the grids over the free nodes at rest and takes the projected Hessian at the matrix's state onto
        them.

        Where `grids` are given they reach only the nodes that were free when they were laid: their matrices are
        then those of before, and nodes that were freed later have their own blocks.
        """
        self.model = model = matrix.model
        self._inverse_diagonal = matrix.inverse_diagonal
        matrix.assemble_projected()
        laid, to_nodes = lay_grids(model.rest[model.free]) if grids is None else grids.reaching(model.free_nodes)
        self._groups = NodeGroups(matrix)
        sizes = [onto.vertices for onto in to_nodes]
        on_device = _Interpolation(model, to_nodes[0])
        onto_nodes = [on_device, *(_Interpolation(model, onto) for onto in to_nodes[1:])]
        bounds = np.cumsum([0, *sizes[-2::-1]])  # of the grids but the last, the coarsest first
        self._grids = model.zeros(wp.types.matrix((3, 3), model.scalar), int(bounds[-1]))
        diagonals = [self._grids[first:end] for first, end in pairwise(bounds.tolist())][::-1]
        self.update: Launch = self._groups.update
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
        inverse = grids.inverse if grids else invert(grid_matrix(matrix, onto_nodes[-1], sizes[-1]))
        self.grids = Grids(laid, to_nodes, inverse)
        if model.parallel.is_cuda:
            self._levels = CudaLevels(model, to_nodes, self._grids, inverse, self._groups)
        else:
            between = [_Interpolation(model, g.interpolate(finer.positions)) for finer, g in pairwise(laid)]
            levels = zip(
                [model.free_nodes, *sizes], sizes, [on_device, *between], [*diagonals, None], strict=False
            )
            self._levels = CpuLevels(model, [_Level(*level) for level in levels], inverse, matrix.bounds)

    def apply(self, r: wp.array, z: wp.array, r_dot_z: Dots) -> Launch:
        """Records z = M^-1 r with r . z, for vectors of the free nodes, shape (free nodes,), vec3."""
        levels = self._levels.apply(self._inverse_diagonal, r, z, r_dot_z)
        if self.model.parallel.is_cuda:
            return levels
        return in_sequence(levels, self._groups.apply(r, z, r_dot_z))

    def apply_with_steps(self, at: Iterates) -> tuple[Launch, Launch]:
        """Records z = M^-1 r, and the same after a step, on CUDA; see `Preconditioner`."""
        assert isinstance(self._levels, CudaLevels)
        return self._levels.apply_with_steps(self._inverse_diagonal, at)


class _Interpolation:
    """An interpolation on the device, as the arguments of the kernels that use it."""

    def __init__(self, model: Model, interpolation: Interpolation) -> None:
        vec8: Any = wp.types.vector(8, model.scalar)
        self.by_point = (model.array(interpolation.vertex, vec8i), model.array(interpolation.weight, vec8))
        self._model, self._interpolation = model, interpolation

    def by_vertex(self) -> tuple[wp.array, wp.array, wp.array]:
        """`Interpolation.by_vertex`."""
        model = self._model
        row_start, point, weight = self._interpolation.by_vertex
        return model.array(row_start, wp.int32), model.array(point, wp.int32), model.array(weight, model.scalar)


@dataclass(frozen=True)
class _Level:
    """A grid, and its interpolation to the nodes or to the next finer grid, its points."""

    points: int
    """Number of points."""
    vertices: int
    """Number of its vertices."""
    interpolation: _Interpolation
    """P, from its vertices to the points."""
    inverse_diagonal: wp.array | None
    """D^-1 of its vertices, weighted, shape (vertices,), mat33; None for the coarsest, which is solved densely."""


class CpuLevels:
    """The grids on the CPU: a launch down and one up for each."""

    strips: wp.array
    """A of the inverse S A S on the coarsest grid, in parts of WHOLE, with ones on its diagonal: strip after strip
    of STRIP rows, each column after column, int16. A preconditioner needs no more digits, and the product is
    limited by the reading of the matrix."""

    def __init__(
        self, model: Model, levels: Sequence[_Level], inverse: np.ndarray, node_bounds: np.ndarray
    ) -> None:
        """Uploads the inverse on the coarsest grid, shape (3 vertices, 3 vertices).

        `node_bounds` are the ranges of nodes, shape (ranges + 1,).
        """
        self._model, self._grids = model, levels
        self._node_bounds, self._ranges = node_bounds, len(node_bounds) - 1
        self._size = size = len(inverse)
        rows = -(-size // STRIP) * STRIP
        root = np.sqrt(np.maximum(np.diagonal(inverse), np.finfo(np.float32).tiny))
        numbers = np.zeros((rows, size), dtype=np.int16)
        numbers[:size] = np.rint(inverse * (KEPT * WHOLE / root)[:, None] / root)
        np.fill_diagonal(numbers, WHOLE)
        scale = np.zeros(rows)
        scale[:size] = root / math.sqrt(WHOLE)
        strips = numbers.reshape(-1, STRIP, size).transpose(0, 2, 1)
        self.strips, self._scale = model.array(strips.ravel(), wp.int16), model.array(scale, model.scalar)

    def apply(self, inverse_diagonal: wp.array, r: wp.array, z: wp.array, r_dot_z: Dots) -> Launch:
        """Records z = M^-1 r with r . z, for the inverse diagonal of the nodes."""
        model = self._model
        kernels, record = cpu_grid_kernels(model.scalar), self._record
        diagonal: wp.array | None = inverse_diagonal
        dots = r_dot_z
        down: list[Launch] = []
        up: list[Launch] = []
        for level in self._grids:
            residual, correction = (  # with room for a whole last strip of the dense product
                model.zeros(model.vec3, level.vertices + STRIP) for _ in range(2)
            )
            by_vertex = level.interpolation.by_vertex()
            bounds = equal_parts(by_vertex[0].numpy(), self._ranges)
            down.append(record(kernels.restrict, bounds, [*by_vertex, r], [residual]))
            finest = level is self._grids[0]
            bounds = self._node_bounds if finest else np.linspace(0, level.points, self._ranges + 1)
            interpolate = [diagonal, *level.interpolation.by_point, correction, r]
            up.append(record(kernels.prolong, bounds, interpolate, [z, dots.iteration, dots.products]))
            diagonal, dots = level.inverse_diagonal, Dots.zero(model)
            r, z = residual, correction
        return in_sequence(*down, self.solve(r, z), *up[::-1])

    def solve(self, residual: wp.array, solution: wp.array) -> Launch:
        """Records the product with the inverse; both are of shape (n + STRIP,), vec3, of which n count."""
        model = self._model
        x, y = (view(vectors, model.scalar, 3 * len(vectors)) for vectors in (residual, solution))
        given, strips = [self._size, self.strips, self._scale, x], len(self._scale) // STRIP
        return self._record(
            cpu_grid_kernels(model.scalar).dense, np.linspace(0, strips, self._ranges + 1), given, [y]
        )

    def _record(self, kernel: Any, bounds: np.ndarray, inputs: Sequence[Any], outputs: Sequence[Any]) -> Launch:
        """Records a loop over ranges, also few items: the threads meet after each launch of a program anyway."""
        return self._model.parallel.record(kernel, bounds.astype(np.int64), inputs, outputs, least=0, loops=True)


class CudaLevels:
    """The grids on CUDA: all interpolate to the nodes, so that three launches apply them after a step.

    Vertices are numbered through from the coarsest grid on.
    """

    def __init__(
        self,
        model: Model,
        grids: Sequence[Interpolation],
        inverse_diagonal: wp.array,
        inverse: np.ndarray,
        groups: NodeGroups,
    ) -> None:
        """Uploads what the launches read.

        Args:
            model: the trunk.
            grids: the interpolation of each to the free nodes, finest first.
            inverse_diagonal: of all but the last, which come last but one first, shape (vertices,), mat33.
            inverse: that of the last, symmetric, shape (3 vertices, 3 vertices).
            groups: of tied nodes.
        """
        self._members, self._of_groups, self._of_nodes = groups.for_cuda()
        self.model = model
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
        numbers, scale = in_half_precision(inverse)
        self._scale, self._inverse = model.array(scale, wp.float32), model.array(numbers, wp.float16)

    def apply(self, inverse_diagonal: wp.array, r: wp.array, z: wp.array, r_dot_z: Dots) -> Launch:
        """Records z = D^-1 r + the corrections of groups and grids, with r . z, for the inverse diagonal."""
        return self._record(inverse_diagonal, Iterates(z, r, z, z, r, r_dot_z, r_dot_z), steps=0)

    def apply_with_steps(self, inverse_diagonal: wp.array, at: Iterates) -> tuple[Launch, Launch]:
        """Records `apply`, and the same after a step along the search direction; see `Preconditioner`."""
        return self._record(inverse_diagonal, at, steps=0), self._record(inverse_diagonal, at, steps=1)

    def _record(self, inverse_diagonal: wp.array, at: Iterates, *, steps: int) -> Launch:
        """The launches, after a step or none; without one, solution, search direction and product are not read."""
        model, kernels, record = self.model, self._kernels, self.model.parallel.record
        rows, columns = len(self._scale), self._inverse.shape[1]
        iteration, r_dot_z, p_dot_q = at.r_dot_z.iteration, at.r_dot_z.products, at.p_dot_q.products
        vec4: Any = wp.types.vector(4, model.scalar)
        residual, correction = model.zeros(vec4, model.free_nodes), model.zeros(vec4, self._vertices)
        coarsest_residual = model.zeros(wp.float32, columns)

        def numbers(array: wp.array) -> wp.array:
            return view(array, model.scalar, 3 * len(array))

        scale = view(self._scale, wp.vec3f, self._coarsest)
        others = self._vertices - self._coarsest - self._far + self._members
        grids = [self._coarsest, self._far, *self._by_vertex, self._inverse_diagonal, scale]
        return in_sequence(
            record(
                kernels.step,
                3 * model.free_nodes,
                [steps, iteration, r_dot_z, p_dot_q, numbers(at.search), numbers(at.product)],
                [numbers(at.solution), numbers(at.residual), view(residual, model.scalar, 4 * len(residual))],
            ),
            record(
                kernels.restrict,
                self._coarsest * BLOCK_LANES + self._far * VERTEX_LANES + others * FEW_LANES,
                [*grids, residual, *self._of_groups],
                [view(coarsest_residual, wp.vec3f, self._coarsest), correction],
                block=BLOCK_LANES,
            ),
            record(
                kernels.dense,
                rows * ROW_LANES,
                [steps, self._inverse, self._scale, coarsest_residual],
                [view(correction, model.scalar, 4 * self._vertices), iteration],
            ),
            record(
                kernels.prolong,
                model.free_nodes * NODE_LANES,
                [
                    view(inverse_diagonal, model.scalar, 9 * len(inverse_diagonal)),
                    *self._by_node,
                    correction,
                    *self._of_nodes,
                    residual,
                    iteration,
                ],
                [numbers(at.preconditioned), r_dot_z],
            ),
        )


def grid_diagonal(matrix: BlockMatrix, whole: _Interpolation, inverse: wp.array, weight: float) -> Launch:
    """Records the inverse diagonal blocks of P^T H P times a weight, for P from a grid's vertices to the nodes."""
    model, size = matrix.model, len(inverse)
    diagonal = model.zeros(inverse.dtype, model.parallel.ranges, size)
    given = [matrix.row_start, matrix.columns, matrix.blocks, *whole.by_point]
    own, lanes = model.array(np.arange(size, dtype=np.int32), wp.int32), CORNERS if model.parallel.is_cuda else 1
    return in_sequence(
        model.parallel.clear(diagonal),
        model.parallel.record(
            grid_matrix_kernels(model.scalar, lanes).grid_diagonal, lanes * model.free_nodes, given, [diagonal]
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
    dense = model.zeros(wp.float64, ranges, 3 * size, 3 * size)
    model.parallel.record(
        grid_matrix_kernels(model.scalar, 1).grid_matrix,
        np.linspace(0, model.free_nodes, ranges + 1).astype(np.int64),
        [matrix.row_start, matrix.columns, matrix.blocks, *whole.by_point],
        [dense],
    )()
    total, *others = dense.numpy()
    for other in others:
        total += other
    return total
