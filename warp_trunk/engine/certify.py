"""The guarantee of CONVERGED: there is an equilibrium within the distance, and it is no saddle.

That no saddle was missed follows from a solve with the true Hessian H by conjugate gradients, which are the
method of Lanczos for A = M^-1/2 H M^-1/2. Let its start v have the component c along an eigenvector whose
eigenvalue is s or less, and let no eigenvalue of the matrix of Lanczos after k iterations be so low. Of all
polynomials q of degree below k with q(s) = 1, the least |q(A) v| follows from the coefficients of the
iterations: its square is 1 / (p_0(s)^2 + ... + p_{k-1}(s)^2) with the orthonormal polynomials p of the start
(Szego, Orthogonal Polynomials, 1939, theorem 3.4.2), and it is at least c^2. At s = 0 the p_j are 1 / |r_j| of
the residuals r_j.

The start is what a solve left, and white noise coloured by D^1/2 of the diagonal blocks D. As the preconditioner
M <= m D for groups of m nodes, its component along any direction is normal with a standard deviation of at least
that of the noise over m^1/2, about a mean that the former gives. The chance that it is below a bound is therefore
at most sqrt(2 / pi) of their ratio, whatever the mesh and its spectrum: the chance of error. Rounding of H is in
the shift s.

Along a soft direction the noise may cancel what the solve left, and rounding of forces moves the equilibrium.
How far follows from the matrix T of Lanczos: a unit of noise along the softest direction, of eigenvalue t, moves
the solution by 1 / t in the norm of M, where the start has moved it by |v| |T^-1 e_1|."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Step:
    """A whole step along the true Hessian."""

    length: float
    """Of its longest vector [mm]."""
    left: float
    """The remaining part of that: by the solve after it, or by how much less the gradient fell [mm]."""


def chance_of_saddle(r_dot_z: np.ndarray, p_dot_q: np.ndarray, noise: float, rounding: float) -> float:
    """The chance that a direction of negative curvature was missed.

    Args:
        r_dot_z: of every iteration of conjugate gradients, shape (k,).
        p_dot_q: the same.
        noise: standard deviation of the noise in the right side, in units of D^1/2.
        rounding: relative to the largest eigenvalue, what rounding may change of an eigenvalue.

    Returns:
        A bound, above 1 where nothing is known; infinite where an eigenvalue of the matrix of Lanczos is no more
        than rounding, which more iterations do not change.
    """
    diagonal, aside = lanczos(r_dot_z, p_dot_q)
    if noise <= 0.0 or len(diagonal) == 0:
        return 1.0
    largest = float((diagonal + np.append(aside, 0.0) + np.append(0.0, aside)).max())  # Gershgorin
    pivots = [float(diagonal[0]) - rounding * largest]
    for middle, side in zip((diagonal[1:] - rounding * largest).tolist(), (aside * aside).tolist(), strict=True):
        if pivots[-1] <= 0.0:
            return math.inf
        pivots.append(middle - side / pivots[-1])
    if pivots[-1] <= 0.0:
        return math.inf
    logarithms = np.cumsum(2.0 * np.log(np.array(pivots[:-1]) / aside))  # of p_j^2 |v|^2, j from 1
    top = float(max(0.0, logarithms.max(initial=0.0)))
    total = math.log(math.exp(-top) + float(np.exp(logarithms - top).sum())) + top
    log_component = 0.5 * (math.log(r_dot_z[0]) - total)
    return math.sqrt(2.0 / math.pi) * math.exp(log_component - math.log(noise))


def response(r_dot_z: np.ndarray, p_dot_q: np.ndarray) -> float:
    """How far a unit of noise moves the solution along the softest direction, as a part of how far it moved.

    Args:
        r_dot_z: of every iteration of conjugate gradients, shape (k,), the first positive.
        p_dot_q: the same.
    """
    diagonal, aside = lanczos(r_dot_z, p_dot_q)
    matrix = np.diag(diagonal) - np.diag(aside, 1) - np.diag(aside, -1)
    moved = np.linalg.solve(matrix, math.sqrt(r_dot_z[0]) * np.eye(len(matrix), 1)[:, 0])
    return float(1.0 / (np.linalg.eigvalsh(matrix)[0] * np.linalg.norm(moved)))


def lanczos(r_dot_z: np.ndarray, p_dot_q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The diagonal of the matrix of Lanczos, and what stands beside it without its sign, of the iterations up to
    where nothing is left."""
    least = np.minimum(r_dot_z, p_dot_q)
    count = int(np.argmax(least <= 0.0)) if (least <= 0.0).any() else len(least)
    r_dot_z, p_dot_q = r_dot_z[:count], p_dot_q[:count]
    alpha, beta = r_dot_z / p_dot_q, r_dot_z[1:] / r_dot_z[:-1]
    diagonal = 1.0 / alpha
    diagonal[1:] += beta / alpha[:-1]
    return diagonal, np.sqrt(beta) / alpha[:-1]


def reach(left: float, steps: Sequence[Step], slowest: float) -> float:
    """How far the equilibrium can be where a Newton step has a length [mm].

    The last step at least as long shows how little the Hessian changes on the way: if it left a part q of itself,
    there is one equilibrium within 1 / (1 - q) of the length (Newton and Kantorovich). q is at most `slowest`,
    also where there was none.
    """
    seen = (step.left / step.length for step in reversed(steps) if step.length >= left > 0.0)
    return left / (1.0 - min(next(seen, slowest), slowest))
