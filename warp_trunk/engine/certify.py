"""The guarantee of CONVERGED: there is an equilibrium within the distance, and it is no saddle.

That no saddle was missed follows from a solve with the true Hessian H by conjugate gradients, which are the
method of Lanczos for A = M^-1/2 H M^-1/2. Let its start v have the component c along an eigenvector whose
eigenvalue is s or less, and let no eigenvalue of the matrix of Lanczos after k iterations be so low. Of all
polynomials q of degree below k with q(s) = 1, the least |q(A) v| follows from the coefficients of the
iterations: its square is 1 / (p_0(s)^2 + ... + p_{k-1}(s)^2) with the orthonormal polynomials p of the start
(Szego, Orthogonal Polynomials, 1939, theorem 3.4.2), and it is at least c^2. At s = 0 the p_j are 1 / |r_j| of
the residuals r_j.

The start is what a solve left, and white noise coloured by D^1/2 of the diagonal blocks D, m^1/2 times as much on
the nodes of a group of m. As the preconditioner M <= m D there, and M <= D elsewhere, its component along any
direction is normal with a standard deviation of at least that of the noise, about a mean that the former gives.
The chance that it is below a bound is therefore at most sqrt(2 / pi) of their ratio, whatever the mesh and its
spectrum: the chance of error. Rounding of H is in
the shift s. The noise has the same seed each time, so that runs agree to the last bit: claims on one trunk are
false no more often for that, but together.

Along a soft direction the noise may cancel what the solve left, and rounding of forces moves the equilibrium.
How far follows from the matrix T of Lanczos: a unit of noise along the softest direction, of eigenvalue t, moves
the solution by 1 / t in the norm of M, where the start has moved it by |v| |T^-1 e_1|."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
import warp as wp

from warp_trunk.kernels.assembly import COLUMNS
from warp_trunk.kernels.vectors import vector_kernels

from .linear import BlockMatrix, ConjugateGradient
from .outcome import LinearSolution
from .parallel import Readback
from .policy import POLICY, Action, Run, stretch

POWERS = 20
"""Of the inverse matrix of Lanczos, by which its largest eigenvalue is found."""


class Certificate:
    """A claim of CONVERGED at the end of a solve; a method for each sentence of its page (solver.md)."""

    def __init__(self, matrix: BlockMatrix, solver: ConjugateGradient, groups: Sequence[Sequence[int]]) -> None:
        """Records the launches.

        Args:
            matrix: the projected Hessian at rest.
            solver: whose solves are continued.
            groups: the nodes whose blocks its preconditioner inverts as a whole.
        """
        self._model, self._solver, self._noise = matrix.model, solver, 0.0
        model, kernels = self._model, vector_kernels(self._model.scalar)
        white = np.random.default_rng(0).standard_normal((model.free_nodes, 3))
        for group in groups:
            white[group] *= len(group) ** 0.5
        factors = [matrix.inverse_diagonal, model.array(white, model.vec3)]
        self._color = model.over_free(kernels.color, factors, [solver.noise])
        blocks = matrix.inverse_diagonal.numpy().astype(float)
        self._stiffness = float((3.0 / np.trace(blocks, axis1=1, axis2=2)).mean())
        """Mean stiffness of a node [energy's unit / mm^2]."""
        before, change = model.free_vectors(), model.free_vectors()
        largest, back = (
            model.zeros(wp.float64, model.parallel.ranges, COLUMNS),
            model.array(-np.ones(1), wp.float64),
        )
        self._keep_solution = partial(wp.copy, before, solver.solution)
        self._largest_change = Readback(model.parallel, largest)
        self._find_change = model.parallel.graph(
            model.over_free(kernels.step, [back, solver.solution, before], [change]),
            largest.zero_,
            model.over_free(kernels.longest, [change, 0], [largest]),
            self._largest_change.send,
        )

    def claim(self, run: Run, solution: LinearSolution, floor: float) -> tuple[Action, int]:
        """Continues a solve with noise until no saddle can have been missed and no soft direction is hidden.

        Args:
            run: the relaxation.
            solution: of the solve.
            floor: the rounding error of distances at the state [mm].

        Returns:
            What comes next, and the linear iterations that were spent.
        """
        run.estimate.floor = max(run.estimate.floor, floor)
        solution = self.begin(solution)
        spent = solution.iterations
        while True:
            first, chance = self.chances_of_saddle()
            hidden, rounding = self.hidden(floor) if chance <= POLICY.chance else (0.0, 0.0)
            run.estimate.floor = max(run.estimate.floor, rounding)
            action = run.after_noise(solution, chance, hidden)
            if action is not Action.CERTIFY:
                return action, spent
            before = solution.iterations
            solution = self._solver.go_on(before + stretch(before, first, chance))
            spent += solution.iterations - before

    def begin(self, solution: LinearSolution) -> LinearSolution:
        """That solve is continued from its residual with noise of the same size."""
        least = POLICY.least_noise * float(np.finfo(self._model.precision).eps)
        self._noise = max(solution.residual_norm / max(3 * self._model.free_nodes, 1) ** 0.5, least)
        self._keep_solution()
        self._color()
        return self._solver.add_noise(self._noise)

    def chances_of_saddle(self) -> tuple[float, float]:
        """No saddle is missed, but with this chance: after the first iteration with noise, and after all."""
        rounding = POLICY.rounding * float(np.finfo(self._model.precision).eps)
        r_dot_z, p_dot_q = self._solver.coefficients()
        first = chance_of_saddle(r_dot_z[:1], p_dot_q[:1], self._noise, rounding)
        return first, chance_of_saddle(r_dot_z, p_dot_q, self._noise, rounding)

    def hidden(self, floor: float) -> tuple[float, float]:
        """Nor is a soft direction hidden: how far noise and rounding of forces may have moved along it [mm]."""
        r_dot_z, p_dot_q = self._solver.coefficients()
        noise = float(r_dot_z[0] / (3 * self._model.free_nodes)) ** 0.5
        rounding = POLICY.rounding_of_forces * floor * self._stiffness**0.5
        self._find_change()
        unit = POLICY.deviations * response(r_dot_z, p_dot_q) * float(self._largest_change.read().max()) ** 0.5
        return noise * unit, rounding * unit


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
