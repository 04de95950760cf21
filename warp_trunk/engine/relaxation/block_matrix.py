"""The curvature of a trunk over its free nodes, as a sparse matrix of 3x3 blocks on the device."""

from __future__ import annotations

import warp as wp

from warp_trunk.kernels.column_products import column_product_kernels
from warp_trunk.kernels.sparse import sparse_kernels

from ..parallel import Launch
from ..state import State
from .columns import Columns
from .dots import Dots
from .half_rows import HalfRows
from .iterates import Iterates
from .plane_rows import PlaneRows
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
        mat33 = wp.types.matrix((3, 3), model.scalar)
        self.sparsity = sparsity or find_sparsity(model)
        self.blocks = model.zeros(mat33, model.parallel.ranges, self.sparsity.blocks)
        self.inverse_diagonal = model.zeros(mat33, model.free_nodes)
        record = self.sparsity.assembly.into(self.blocks, state.displacement)
        self._set_positive, self._set_true = record("curvature"), record("true_curvature")
        self._rows = (PlaneRows if model.parallel.is_cuda else HalfRows)(model, self.sparsity, self.blocks)
        self._invert_diagonal = model.over_free(
            sparse_kernels(model.scalar).invert_diagonal,
            [self.sparsity.diagonal, self.blocks, model.scalar(1.0)],
            [self.inverse_diagonal],
        )

    def assemble(self) -> None:
        """Sets the matrix to the curvature at the state as it is now, made positive semidefinite."""
        self._set_positive()
        self._rows.take()
        self._invert_diagonal()

    def assemble_true(self) -> None:
        """Sets the matrix to the true curvature, which may be indefinite; `inverse_diagonal` stays positive."""
        self._set_true()
        self._rows.take()

    def multiply(self, p: wp.array, q: wp.array, p_dot_q: Dots) -> Launch:
        """Records q = H p with p . q on the CPU, for vectors of the free nodes, shape (free nodes,), vec3."""
        assert isinstance(self._rows, HalfRows)
        return self._rows.multiply(p, q, p_dot_q)

    def turn_and_multiply(self, at: Iterates) -> Launch:
        """Records p = z + beta p and q = H p with p . q in one launch, on CUDA."""
        assert isinstance(self._rows, PlaneRows)
        return self._rows.turn_and_multiply(at)

    def multiply_columns(self, columns: Columns, p: wp.array, q: wp.array, p_dot_q: wp.array) -> Launch:
        """Records q = H p with p . q of each column, for fields of the free nodes; see `Columns`."""
        s = self.sparsity
        return columns.over_groups(
            column_product_kernels(*columns.variant).multiply,
            self.model.free_nodes,
            [s.row_start, s.columns, self.blocks, p],
            [q, p_dot_q],
        )
