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
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial
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
    OCTET,
    ROW_LANES,
    STRIP,
    VERTEX_LANES,
    WHOLE,
    cpu_grid_kernels,
    cuda_grid_kernels,
    grid_matrix_kernels,
    vec8i,
)
from warp_trunk.kernels.node_groups import MEMBERS, WARP, node_group_kernels
from warp_trunk.kernels.sparse import diagonal_inverter

from .linear import BlockMatrix, Dots, Iterates
from .model import Model
from .parallel import Launch, in_sequence, view
from .topology import equal_parts

MOST_DENSE = 4
"""Threads that add up the matrix on the coarsest grid at most: each needs one of its own, 30 MB on the anatomy."""
SHIFT, IDLE_SHIFT = 1e-6, 1e-3
"""Addition to a unit diagonal; and where a grid has vertices with next to no nodes, whose directions, 1e6
times as soft as others, would leave 16 bits with no digits for the others."""
LEAST_SUPPORT = 0.01
"""A grid vertex that reaches its points with a smaller sum of squared weights is left out."""
DENSE_CELLS = 480
"""Most cells of the coarsest grid that hold nodes; about as many vertices, three rows of the inverse for each."""
FINEST_SPACING = 1.15
"""No grid is finer than this many mean distances of nodes: below, the nodes' own blocks do the work."""
OFFSETS = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)])
"""Corners of a cell."""
STIFF = 0.45
"""Nodes are tied whose block off the diagonal is this part of their blocks on it, by norm: one of a hundred links
of the anatomy, of the papers' energy one of twenty. With 0.5 the certificate of the default takes 100 linear
iterations, with 0.45 68, with 0.4 64; without groups 164."""


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


def in_half_precision(inverse: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A symmetric positive matrix (n, n) with ones on its diagonal, and the scales of its rows and columns (n,).

    The matrix is float16, its rows filled up to whole octets; see `KEPT`. None of its numbers overflows.
    """
    scale = np.sqrt(np.maximum(np.diagonal(inverse), np.finfo(np.float32).tiny))
    numbers = np.zeros((len(inverse), -(-len(inverse) // OCTET) * OCTET), dtype=np.float16)
    numbers[:, : len(inverse)] = inverse * (KEPT / scale[:, None]) / scale
    np.fill_diagonal(numbers, 1.0)
    return numbers, scale


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
    inverse[layers[-1], layers[-1]] = np.linalg.inv(pivot)
    for layer, following, across in zip(layers[-2::-1], layers[:0:-1], carried[::-1], strict=True):
        beyond = slice(layer.stop, size)
        inverse[layer, beyond] = -across @ inverse[following, beyond]
        inverse[layer, layer] -= inverse[layer, following] @ across.T
    return _mirrored(inverse)


def _mirrored(matrix: np.ndarray) -> np.ndarray:
    """The symmetric matrix with the same numbers on and above its diagonal."""
    return np.triu(matrix) + np.triu(matrix, 1).T


@dataclass(frozen=True, eq=False)
class CoarseGrid:
    """The vertices of a regular grid that reach a set of points."""

    origin: np.ndarray
    """Vertex (0, 0, 0) [mm], shape (3,)."""
    spacing: float
    """Edge of a cell [mm]."""
    number: np.ndarray
    """Number of each vertex of the grid's box, -1 where left out, shape (nx, ny, nz)."""
    positions: np.ndarray
    """Where the numbered vertices are [mm], shape (vertices, 3)."""

    @classmethod
    def around(cls, points: np.ndarray, origin: np.ndarray, spacing: float) -> tuple[CoarseGrid, Interpolation]:
        """The grid over points (points, 3), none of them below the origin [mm], and its interpolation to them."""
        cell, weight = weights(points, origin, spacing)
        size = cell.max(axis=1) + 2
        support = np.zeros(size.prod())
        vertex = _corners(cell, size)
        for own, part in zip(vertex, weight, strict=True):
            support += np.bincount(own, part**2, minlength=len(support))
        kept = (support >= min(LEAST_SUPPORT, support.max())).reshape(size)
        axes = np.argsort(-size, kind="stable")  # layers across the longest axis follow each other: see `invert`
        place = np.empty((np.count_nonzero(kept), 3), dtype=np.int64)
        place[:, axes] = np.argwhere(kept.transpose(axes))
        number = np.full(size, -1, dtype=np.int32)
        number[tuple(place.T)] = np.arange(len(place))
        grid = cls(origin, spacing, number, origin + spacing * place)
        return grid, grid._between(vertex, weight)

    def interpolate(self, points: np.ndarray) -> Interpolation:
        """Weights of the grid's vertices at points inside its cells [mm], shape (points, 3)."""
        size = np.array(self.number.shape)
        cell, weight = weights(points, self.origin, self.spacing, size - 2)
        return self._between(_corners(cell, size), weight)

    def _between(self, corner: np.ndarray, weight: np.ndarray) -> Interpolation:
        """The interpolation by corners in the grid's box and their weights, both of shape (8, points)."""
        vertex = self.number.ravel().take(corner)
        weight[vertex < 0] = 0.0
        return Interpolation(
            vertex=np.ascontiguousarray(np.maximum(vertex, 0).T),
            weight=np.ascontiguousarray(weight.T),
            vertices=len(self.positions),
        )


def lay_grids(points: np.ndarray) -> tuple[tuple[CoarseGrid, ...], tuple[Interpolation, ...]]:
    """Grids over points (points, 3) [mm], finest first, and the interpolation of each to them."""
    spacings = find_spacings(points)
    origin = points.min(axis=0) - 1e-3 * spacings[-1]

    def lay(spacing: float) -> tuple[CoarseGrid, Interpolation]:
        return CoarseGrid.around(points, origin, spacing)

    with ThreadPoolExecutor(len(spacings)) as pool:  # NumPy releases the interpreter lock
        laid, to_points = zip(*pool.map(lay, spacings), strict=True)
    return laid, to_points


@dataclass(frozen=True, eq=False)
class Grids:
    """The grids of a trunk on the host, and what is solved on the coarsest."""

    laid: tuple[CoarseGrid, ...]
    """The grids, finest first."""
    to_nodes: tuple[Interpolation, ...]
    """The interpolation of each to the free nodes."""
    inverse: np.ndarray
    """Of the matrix on the coarsest at rest, shape (3 vertices, 3 vertices)."""

    def reaching(self, nodes: int) -> tuple[tuple[CoarseGrid, ...], tuple[Interpolation, ...]]:
        """The grids and their interpolations to so many nodes, of which they do not reach the last."""
        return self.laid, tuple(each.among(nodes) for each in self.to_nodes)


@dataclass(frozen=True, eq=False)
class Interpolation:
    """Weights of the grid vertices around each point."""

    vertex: np.ndarray
    """Vertices of the cell a point lies in, shape (points, 8), int32."""
    weight: np.ndarray
    """Their trilinear weights, 0 for a vertex left out, shape (points, 8)."""
    vertices: int
    """Number of vertices of the grid."""

    def among(self, points: int) -> Interpolation:
        """The same among more points, of which the grid does not reach the last."""
        more = [(0, points - len(self.vertex)), (0, 0)]
        return Interpolation(np.pad(self.vertex, more), np.pad(self.weight, more), self.vertices)

    @cached_property
    def by_vertex(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The same by vertex.

        That is: its first entry in the two other arrays (vertices + 1,), int32, the points that it reaches,
        ascending, int32, and their weights.
        """
        entry = np.flatnonzero(self.weight.ravel() > 0.0)
        number = self.vertex.ravel()[entry]
        short = number.astype(np.uint16) if self.vertices <= 1 << 16 else number  # sorted much faster
        entry = entry[np.argsort(short, kind="stable")]
        count = np.bincount(number, minlength=self.vertices)
        row_start = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
        return row_start, (entry // 8).astype(np.int32), self.weight.ravel()[entry]


def weights(
    points: np.ndarray, origin: np.ndarray, spacing: float, last_cell: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The cell of each point, (3, points), and the weights of its corners, (8, points)."""
    place = np.ascontiguousarray(((points - origin) / spacing).T)
    cell = np.floor(place).astype(np.int64)
    if last_cell is not None:
        cell = np.minimum(cell, last_cell[:, None])
    upper = place - cell
    x, y, z = np.stack([1.0 - upper, upper], axis=1)  # of the lower and the upper corner along each axis
    return cell, np.stack([x[i] * y[j] * z[k] for i, j, k in OFFSETS])


def _corners(cell: np.ndarray, size: np.ndarray) -> np.ndarray:
    """The corners of cells (3, cells) in the box of a grid, in C order, shape (8, cells)."""
    strides = np.array([size[1] * size[2], size[2], 1])
    return (OFFSETS @ strides)[:, None] + strides @ cell


def find_spacings(points: np.ndarray) -> list[float]:
    """Spacings of the grids over points (points, 3), finest first, each twice the one before [mm]."""
    coarsest = float(np.ptp(points, axis=0).max(initial=1e-6))
    most = min(DENSE_CELLS, len(points) / 8)
    along = np.ascontiguousarray((points - points.min(axis=0)).T)
    while occupied_cells(along, coarsest / 1.1) <= most:
        coarsest /= 1.1
    quarter = 0.25 * coarsest
    node_distance = quarter * (occupied_cells(along, quarter) / len(points)) ** (1.0 / 3.0)
    spacings = [coarsest]
    while 0.5 * spacings[0] >= FINEST_SPACING * node_distance:
        spacings.insert(0, 0.5 * spacings[0])
    return spacings


def occupied_cells(along: np.ndarray, spacing: float) -> int:
    """Number of cells of a regular grid that hold a point, by its distance along each axis, (3, points)."""
    cells = (along / spacing).astype(np.int64)
    size = cells.max(axis=1) + 1
    occupied = np.zeros(size.prod(), dtype=bool)
    occupied[(cells[0] * size[1] + cells[1]) * size[2] + cells[2]] = True
    return int(np.count_nonzero(occupied))


class NodeGroups:
    """The groups of nodes that stiff links tie: the preconditioner inverts their block as a whole.

    Flat and thin tetrahedra tie nodes to each other. Their common motion is soft beside that: their own blocks do
    not show it, and a grid does not reach it. What ties them is the shape of the mesh, so the groups of the trunk
    at rest serve every increment; their blocks are those of the matrix that holds."""

    members: list[list[int]]
    """The nodes of each group, ascending."""

    def __init__(self, matrix: BlockMatrix) -> None:
        """Ties the nodes by the matrix as it is."""
        self._model = model = matrix.model
        columns, size = matrix.columns.numpy(), model.free_nodes
        rows = np.repeat(np.arange(size), np.diff(matrix.row_start.numpy()).astype(np.int64))
        upper = np.flatnonzero(columns >= rows)
        rows, columns = rows[upper], columns[upper]
        self.members = groups = tie(rows, columns, matrix.blocks.numpy()[upper], size)
        count = np.array([len(group) for group in groups], dtype=np.int64)
        keys, pairs = rows * size + columns, [(a, b) for group in groups for a in group for b in group]
        one, other = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        wanted = np.minimum(one, other) * size + np.maximum(one, other)
        at = np.searchsorted(keys, wanted).clip(0, len(keys) - 1)
        block_of = np.where(keys[at] == wanted, np.where(one <= other, 1, -1) * (upper[at] + 1), 0)
        start = 9 * np.cumsum([0, *count**2])
        self._nodes = np.array([node for group in groups for node in group], dtype=np.int64)
        self._group_of = np.repeat(np.arange(len(groups)), count)
        self._where = [model.array(each, wp.int32) for each in (np.cumsum([0, *count]), start, self._nodes)]
        self._inverse = model.zeros(model.scalar, int(start[-1]))
        self._kernels, cuda = node_group_kernels(*model.variant), model.parallel.is_cuda
        self.update: Launch = model.parallel.record(
            self._kernels.invert,
            WARP * len(groups) if cuda else len(groups),
            [*self._where, model.array(block_of, wp.int32), matrix.blocks, matrix.inverse_diagonal],
            [self._inverse],
            least=0,
            loops=not cuda,
        )
        """Sets the groups' blocks to those of the matrix as it is, projected, and inverts them."""

    def apply(self, r: wp.array, z: wp.array, r_dot_z: Dots) -> Launch:
        """Records, on the CPU, the change of z and of r . z by the groups' blocks, after D^-1 of the nodes' own.

        Both are vectors of the free nodes, shape (free nodes,), vec3.
        """
        given, changed = [*self._where, self._inverse, r], [z, r_dot_z.iteration, r_dot_z.products]
        kernel, groups = self._kernels.apply, len(self.members)
        return self._model.parallel.record(kernel, groups, given, changed, least=0, loops=True)

    def for_cuda(self) -> tuple[int, list[wp.array], list[wp.array]]:
        """How many nodes are members; what a launch reads to correct them, and writes by member; and what another
        reads to find the correction of a node."""
        model, count = self._model, len(self._nodes)
        member_of = np.full(model.free_nodes, -1)
        member_of[self._nodes] = np.arange(count)
        correction = model.zeros(model.vec3, max(count, 1))
        given = [*self._where, model.array(self._group_of, wp.int32), self._inverse, correction]
        numbers = view(correction, model.scalar, 3 * len(correction))
        return count, given, [model.array(member_of, wp.int32), numbers]


def tie(rows: np.ndarray, columns: np.ndarray, blocks: np.ndarray, size: int) -> list[list[int]]:
    """Groups of at most MEMBERS nodes, ascending, by their stiffest links.

    Args:
        rows: row of each 3x3 block on or above the diagonal of a symmetric matrix, shape (blocks,).
        columns: its column, shape (blocks,).
        blocks: the blocks, shape (blocks, 3, 3).
        size: number of nodes.
    """
    norm, diagonal = np.sqrt(np.einsum("bij,bij->b", blocks, blocks)), rows == columns
    root = np.zeros(size)
    root[rows[diagonal]] = np.sqrt(np.maximum(norm[diagonal], np.finfo(norm.dtype).tiny))
    part = norm / (root[rows] * root[columns])
    stiff = np.flatnonzero((part > STIFF) & ~diagonal)
    stiff = stiff[np.argsort(-part[stiff], kind="stable")]
    group_of: dict[int, list[int]] = {}
    for a, b in zip(rows[stiff].tolist(), columns[stiff].tolist(), strict=True):
        one, other = group_of.setdefault(a, [a]), group_of.setdefault(b, [b])
        if one is not other and len(one) + len(other) <= MEMBERS:
            one += other
            group_of.update(dict.fromkeys(other, one))
    return sorted({id(group): sorted(group) for group in group_of.values() if len(group) > 1}.values())
