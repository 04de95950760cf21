"""Ways to solve with the stiffness of the free nodes. Each takes a matrix apart and returns what solves with it.

A matrix is symmetric and ordered by component, then node.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

Solve = Callable[[np.ndarray], np.ndarray]
"""From a right-hand side to the solution, both of shape (3 nodes,)."""
Factorise = Callable[[scipy.sparse.csr_array], Solve]
"""From a matrix to what solves with it; factors may raise ArithmeticError where there are none."""
RESIDUAL = 1e-6
"""Relative residual at which conjugate gradients end."""


def superlu(matrix: scipy.sparse.csr_array) -> Solve:
    """LU factors by SuperLU, which SciPy holds, in the order of least degree of a symmetric matrix."""
    options = {"SymmetricMode": True}
    return scipy.sparse.linalg.splu(
        matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options
    ).solve


def jacobi(matrix: scipy.sparse.csr_array) -> Solve:
    """SciPy's conjugate gradients with the diagonal."""
    inverse = scipy.sparse.diags_array(np.reciprocal(matrix.diagonal()))

    def solve(b: np.ndarray) -> np.ndarray:
        return scipy.sparse.linalg.cg(matrix, b, rtol=RESIDUAL, M=inverse)[0]

    return solve
