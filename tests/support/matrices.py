"""The Hessian of a trunk for NumPy and SciPy."""

import numpy as np
from scipy.sparse import bsr_array
from warp_trunk.kernels.assembly import PAIRS

from warp_trunk.engine.linear import BlockMatrix


def upper_blocks(matrix: BlockMatrix) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows and columns of the blocks on and above the diagonal, and the blocks, shape (blocks, 3, 3)."""
    row_start, columns = matrix.row_start.numpy(), matrix.columns.numpy()
    rows = np.searchsorted(row_start, np.arange(len(columns)), side="right") - 1
    upper = np.flatnonzero(columns >= rows)
    return rows[upper], columns[upper], matrix.blocks.numpy()[upper]


def on_host(matrix: BlockMatrix) -> bsr_array:
    """The whole matrix."""
    rows, columns, blocks = upper_blocks(matrix)
    start = np.searchsorted(rows, np.arange(matrix.model.free_nodes + 1))
    above = bsr_array((np.where((columns > rows)[:, None, None], blocks, 0.0), columns, start))
    return bsr_array((blocks, columns, start)) + above.T


def element_matrices(blocks: np.ndarray) -> np.ndarray:
    """The matrices of stencils, shape (stencils, 12, 12), by their blocks of `PAIRS`, one after the other."""
    found = np.empty((len(blocks) // len(PAIRS), 4, 4, 3, 3))
    for k, (a, b) in enumerate(PAIRS):
        found[:, a, b] = blocks[k :: len(PAIRS)]
        found[:, b, a] = found[:, a, b].transpose(0, 2, 1)
    return found.transpose(0, 1, 3, 2, 4).reshape(-1, 12, 12)


def places_apart(stencils: int) -> np.ndarray:
    """Where each block of stencils is added to a place of its own, shape (stencils, 10), int32."""
    return 2 * np.arange(len(PAIRS) * stencils, dtype=np.int32).reshape(-1, len(PAIRS))
