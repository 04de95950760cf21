"""Ways to solve with the stiffness of the free nodes. Each takes a matrix apart and returns what solves with it.

A matrix is symmetric and ordered by component, then node. All but SciPy's own solvers are optional packages.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from .motions import rigid_motions

Solve = Callable[[np.ndarray], np.ndarray]
"""From a right-hand side to the solution, both of shape (3 nodes,)."""
Factorise = Callable[[scipy.sparse.csr_array, np.ndarray], Solve]
"""From a matrix and the places of its nodes (nodes, 3) to what solves with it; Cholesky factors raise
ArithmeticError where the matrix is not positive definite."""
RESIDUAL = 1e-6
"""Relative residual at which conjugate gradients end."""
ORDER, FACTORISE, SOLVE = 11, 22, 33
"""Phases of PARDISO."""


class Pardiso:
    """Cholesky factors by Intel's MKL on all cores, through pypardiso; one matrix at a time.

    The order of elimination is found once and serves all matrices with the same places of entries.
    """

    def __init__(self) -> None:
        # real, symmetric, positive definite: it takes the upper triangle
        self._package = import_module("pypardiso")
        self._solver = self._package.PyPardisoSolver(mtype=2)
        self._ordered = scipy.sparse.csr_array((0, 0))

    def __call__(self, matrix: scipy.sparse.csr_array, places: np.ndarray) -> Solve:
        try:
            upper = self.order(matrix)
            self._run(FACTORISE, upper)
        except self._package.pardiso_wrapper.PyPardisoError as error:
            raise ArithmeticError("not positive definite") from error
        return lambda b: self._run(SOLVE, upper, b)

    def order(self, matrix: scipy.sparse.csr_array) -> scipy.sparse.csr_array:
        """Finds the order of elimination where it is not known yet; gives the upper triangle."""
        upper = scipy.sparse.csr_array(scipy.sparse.triu(matrix, format="csr"))
        known = all(
            np.array_equal(getattr(upper, name), getattr(self._ordered, name)) for name in ("indptr", "indices")
        )
        if not known:
            self._run(ORDER, upper)
            self._ordered = upper
        return upper

    def _run(self, phase: int, upper: scipy.sparse.csr_array, b: np.ndarray | None = None) -> np.ndarray:
        self._solver.set_phase(phase)
        return self._solver._call_pardiso(upper, np.zeros(len(upper.indptr) - 1) if b is None else b)


def cholmod(matrix: scipy.sparse.csr_array, places: np.ndarray) -> Solve:
    """Supernodal Cholesky factors by SuiteSparse, through CVXOPT."""
    cvxopt, cholesky = import_module("cvxopt"), import_module("cvxopt.cholmod")
    lower = scipy.sparse.tril(matrix, format="coo")
    stored = cvxopt.spmatrix(lower.data, lower.row.astype(int), lower.col.astype(int), lower.shape)
    factors = cholesky.symbolic(stored)
    cholesky.numeric(stored, factors)

    def solve(b: np.ndarray) -> np.ndarray:
        x = cvxopt.matrix(b)
        cholesky.solve(factors, x)
        return np.array(x).ravel()

    return solve


def superlu(matrix: scipy.sparse.csr_array, places: np.ndarray) -> Solve:
    """LU factors by SuperLU, which SciPy holds, in the order of least degree of a symmetric matrix."""
    options = {"SymmetricMode": True}
    return scipy.sparse.linalg.splu(
        matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options
    ).solve


def multigrid(matrix: scipy.sparse.csr_array, places: np.ndarray) -> Solve:
    """Conjugate gradients with smoothed aggregation on the rigid motions, by PyAMG."""
    by_node = np.arange(3 * len(places)).reshape(3, -1).T.ravel()
    blocks = scipy.sparse.csr_array(matrix[by_node][:, by_node]).tobsr((3, 3))
    levels = import_module("pyamg").smoothed_aggregation_solver(blocks, B=rigid_motions(places))

    def solve(b: np.ndarray) -> np.ndarray:
        x = np.empty_like(b)
        x[by_node] = levels.solve(b[by_node], tol=RESIDUAL, accel="cg", maxiter=500)
        return x

    return solve


def jacobi(matrix: scipy.sparse.csr_array, places: np.ndarray) -> Solve:
    """SciPy's conjugate gradients with the diagonal."""
    inverse = scipy.sparse.diags_array(np.reciprocal(matrix.diagonal()))

    def solve(b: np.ndarray) -> np.ndarray:
        return scipy.sparse.linalg.cg(matrix, b, rtol=RESIDUAL, M=inverse)[0]

    return solve


def available() -> dict[str, Factorise]:
    """The solvers whose packages are installed, by name, the fastest on trunks first; SciPy's always are."""
    solvers: dict[str, Factorise] = {}
    if find_spec("pypardiso"):
        solvers["MKL PARDISO, Cholesky"] = Pardiso()
    if find_spec("cvxopt"):
        solvers["CVXOPT CHOLMOD"] = cholmod
    if find_spec("pyamg"):
        solvers["PyAMG smoothed aggregation, CG"] = multigrid
    return {**solvers, "SciPy CG, Jacobi": jacobi, "SciPy SuperLU": superlu}
