"""The blocks that a product on CUDA reads: each of their nine numbers in a plane of its own."""

from __future__ import annotations

import warp as wp

from warp_trunk.kernels.row_product import LANES, PLANES, row_product_kernels

from ..model import Model
from ..parallel import Launch, view
from .iterates import Iterates
from .sparsity import Sparsity


class PlaneRows:
    """Copies of all blocks, so that neighbouring threads read neighbouring numbers; see `row_product`."""

    def __init__(self, model: Model, sparsity: Sparsity, blocks: wp.array) -> None:
        """Of the only slab of some blocks."""
        self._model, self._sparsity = model, sparsity
        self._planes = model.zeros(model.scalar, PLANES, sparsity.blocks)
        self.take: Launch = model.parallel.record(
            row_product_kernels(model.scalar).spread, sparsity.blocks, [blocks], [self._planes]
        )
        """Copies the blocks as they are now."""

    def turn_and_multiply(self, at: Iterates) -> Launch:
        """Records p = z + beta p and q = H p with p . q in one launch."""
        model, pattern = self._model, self._sparsity
        z, p, q = (
            view(array, model.scalar, 3 * len(array)) for array in (at.preconditioned, at.search, at.product)
        )
        r_dot_z = at.r_dot_z
        return model.parallel.record(
            row_product_kernels(model.scalar).turn_and_multiply,
            LANES * model.free_nodes,
            [
                pattern.row_start,
                pattern.columns,
                self._planes,
                r_dot_z.iteration,
                r_dot_z.products,
                at.preconditioned,
                z,
            ],
            [p, q, at.p_dot_q.products],
        )
