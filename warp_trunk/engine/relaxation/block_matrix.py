"""The curvature of a trunk over its free nodes, as a sparse matrix of 3x3 blocks on the device."""

from __future__ import annotations

import warp as wp

from warp_trunk.kernels.column_products import column_product_kernels
from warp_trunk.kernels.slabs import slab_kernels
from warp_trunk.kernels.sparse import ROW_LANES, sparse_kernels

from ..parallel import Launch
from ..state import State
from .columns import Columns
from .dots import Dots
from .half_rows import HalfRows
from .sparsity import Sparsity, find_sparsity


class BlockMatrix:
    """H at a state: zero when made, the state's curvature after each `assemble`."""

    sparsity: Sparsity
    """Which blocks there are."""
    blocks: wp.array
    """The blocks in the first slab, shape (ranges, blocks), mat33; the others are what the threads add into."""
    inverse_diagonal: wp.array
    """The inverse of each row's diagonal block, made positive, shape (free nodes,), mat33."""

    def __init__(self, state: State, sparsity: Sparsity | None = None) -> None:
        """Finds the pattern and records the launches.

        Args:
            state: where the curvature is taken; it may change between two assemblies.
            sparsity: the pattern, when another matrix of this model has found it.
        """
        self.model = model = state.model
        ranges, record = model.parallel.ranges, model.parallel.record
        mat33 = wp.types.matrix((3, 3), model.scalar)
        self.sparsity = sparsity or find_sparsity(model)
        size = self.sparsity.blocks
        self.blocks = model.zeros(mat33, ranges, size)
        self.inverse_diagonal = model.zeros(mat33, model.free_nodes)
        clear = record(slab_kernels(mat33).clear, size, [ranges], [self.blocks])
        self._clear = self.blocks.zero_ if model.parallel.is_cuda else clear
        kernels, at = model.elements.kernels, [self.sparsity.block_of, state.displacement]
        self._add_positive = model.over_tets(kernels.curvature, at, [self.blocks])
        self._add_true = model.over_tets(kernels.true_curvature, at, [self.blocks])
        self._gather = record(slab_kernels(mat33).gather, size, [ranges], [self.blocks])
        at = self.sparsity.lower, self.sparsity.mirrored
        self._mirror = record(sparse_kernels(*model.variant).mirror, len(at[0]), at, [self.blocks])
        self._half = None if model.parallel.is_cuda else HalfRows(model, self.sparsity, self.blocks)
        self._invert_diagonal = model.over_free(
            sparse_kernels(*model.variant).invert_diagonal,
            [self.sparsity.diagonal, self.blocks, model.scalar(1.0)],
            [self.inverse_diagonal],
        )

    def assemble(self) -> None:
        """Sets the matrix to the curvature at the state as it is now, made positive semidefinite."""
        self._sum(self._add_positive)
        self._invert_diagonal()

    def assemble_true(self) -> None:
        """Sets the matrix to the true curvature, which may be indefinite; `inverse_diagonal` stays positive."""
        self._sum(self._add_true)

    def _sum(self, add: Launch) -> None:
        self._clear()
        add()
        if self.model.parallel.ranges > 1:
            self._gather()
        self._mirror()
        if self._half is not None:
            self._half.take()

    def multiply(self, p: wp.array, q: wp.array, p_dot_q: Dots) -> Launch:
        """Records q = H p with p . q on the CPU, for vectors of the free nodes, shape (free nodes,), vec3."""
        assert self._half is not None
        return self._half.multiply(p, q, p_dot_q)

    def turn_and_multiply(self, z: wp.array, p: wp.array, q: wp.array, r_dot_z: Dots, p_dot_q: Dots) -> Launch:
        """Records p = z + beta p and q = H p with p . q in one launch, on CUDA; see `multiply`."""
        s = self.sparsity
        return self.model.parallel.record(
            sparse_kernels(*self.model.variant).turn_and_multiply,
            self.model.free_nodes * ROW_LANES,
            [s.row_start, s.columns, self.blocks, p_dot_q.iteration, r_dot_z.products, z],
            [p, q, p_dot_q.products],
        )

    def multiply_columns(self, columns: Columns, p: wp.array, q: wp.array, p_dot_q: wp.array) -> Launch:
        """Records q = H p with p . q of each column, for fields of the free nodes; see `Columns`."""
        s = self.sparsity
        return columns.over_groups(
            column_product_kernels(*columns.variant).multiply,
            self.model.free_nodes,
            [s.row_start, s.columns, self.blocks, p],
            [q, p_dot_q],
        )
