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

POWERS = 20
"""Of the inverse matrix of Lanczos, by which its largest eigenvalue is found."""


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
    r_dot_z, p_dot_q = until_nothing_is_left(r_dot_z, p_dot_q)
    if noise <= 0.0 or len(r_dot_z) == 0:
        return 1.0
    alpha, beta = r_dot_z / p_dot_q, r_dot_z[1:] / r_dot_z[:-1]
    diagonal, aside = 1.0 / alpha, np.sqrt(beta) / alpha[:-1]
    diagonal[1:] += beta / alpha[:-1]
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

    The iterations have factored the matrix of Lanczos, so that its inverse is two cumulative sums; powers of that
    find the softest direction.

    Args:
        r_dot_z: of every iteration of conjugate gradients, shape (k,), the first positive.
        p_dot_q: the same.
    """
    r_dot_z, p_dot_q = until_nothing_is_left(r_dot_z, p_dot_q)
    root, decrease = np.sqrt(r_dot_z), r_dot_z * r_dot_z / p_dot_q

    def solution(right_side: np.ndarray) -> np.ndarray:
        return np.cumsum((decrease * np.cumsum(right_side / root))[::-1])[::-1] / root

    moved = vector = solution(root * (np.arange(len(root)) == 0))
    for _ in range(POWERS):
        vector = solution(vector / np.linalg.norm(vector))
    return float(np.linalg.norm(vector) / np.linalg.norm(moved))


def until_nothing_is_left(r_dot_z: np.ndarray, p_dot_q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The iterations before the first whose residual or curvature is rounding."""
    nothing = np.minimum(r_dot_z, p_dot_q) <= 0.0
    count = int(np.argmax(nothing)) if nothing.any() else len(nothing)
    return r_dot_z[:count], p_dot_q[:count]


def reach(left: float, steps: Sequence[Step], slowest: float) -> float:
    """How far the equilibrium can be where a Newton step has a length [mm].

    The last step at least as long shows how little the Hessian changes on the way: if it left a part q of itself,
    there is one equilibrium within 1 / (1 - q) of the length (Newton and Kantorovich). q is at most `slowest`,
    also where there was none.
    """
    seen = (step.left / step.length for step in reversed(steps) if step.length >= left > 0.0)
    return left / (1.0 - min(next(seen, slowest), slowest))
