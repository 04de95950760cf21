"""A trunk linearised at an equilibrium: what its numbers depend on, and how its tissue follows small changes.

At an equilibrium the gradient of the free nodes vanishes, F(u; b, c) = 0 for the displacement u of free nodes, b
of prescribed ones and constants c. Small changes keep it so: H du = -(dF/db db + dF/dc dc) with the true curvature
H = dF/du. A number N(u) therefore changes by dN = -l . (dF/db db + dF/dc dc), where H l = dN/du: one linear solve
for the number (its adjoint l) gives its derivative in everything, since H is symmetric.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from warp_trunk.errors import InputError

from .constants import Constant, weight_derivative
from .coupling import Coupling
from .model import Model
from .relaxation.block_matrix import BlockMatrix
from .relaxation.conjugate_gradient import ConjugateGradient
from .relaxation.multilevel import Multilevel
from .relaxation.outcome import RelaxStatus
from .simulation import Increment
from .state import State

ACCURACY = 1e-3
"""Part of the longest vector of a solution by which any of its vectors may be wrong; derivatives of the anatomy in
its landmarks are then right to 0.2 %."""
MOST_ITERATIONS = 2000
"""Of one linear solve; many times what a stable equilibrium takes."""


class Linearization:
    """The linear problem at the end of a relaxation; fields are in mesh order, shape (nodes, 3)."""

    iterations: int
    """Products with the curvature so far."""

    def __init__(self, model: Model, increment: Increment, accuracy: float = ACCURACY) -> None:
        """Assembles the true curvature at the increment.

        Args:
            model: the trunk.
            increment: one of a simulation of it.
            accuracy: part of the longest vector of a solution by which a vector may be wrong.

        Raises:
            InputError: a relaxation that did not converge: what is no equilibrium has no such derivative.
        """
        if increment.relaxation.status is not RelaxStatus.CONVERGED:
            raise InputError(
                f"sensitivities: the relaxation must have ended with CONVERGED, not "
                f"{increment.relaxation.status.name}; simulate with more steps or a larger tolerance"
            )
        self.model, self._accuracy = model, accuracy
        self.iterations = 0
        self._state = State(model)
        self._state.displacement.assign(increment.from_rest)
        if not model.free_nodes:
            return
        matrix = BlockMatrix(self._state)
        matrix.assemble()
        preconditioner = Multilevel(matrix)
        matrix.assemble_true()
        self._load = model.free_vectors()
        self._solver = ConjugateGradient(matrix, preconditioner, self._load, MOST_ITERATIONS)
        self._coupling = Coupling(self._state)

    def adjoint(self, weight: np.ndarray) -> np.ndarray:
        """l with H l = dN/du, of a number's derivative in the place of every node; 0 on prescribed nodes."""
        return self._in_mesh_order(self._solve(self._in_model_order(weight)[self.model.free]))

    def by_bones(self, adjoint: np.ndarray) -> np.ndarray:
        """dN/db, the derivative of a number in the place of every prescribed node; 0 on free nodes."""
        derivative = np.zeros((self.model.nodes, 3))
        if self.model.free_nodes:
            free = self._in_model_order(adjoint)[self.model.free]
            derivative[self.model.prescribed] = -self._coupling.transposed_times(free)
        return self._in_mesh_order(derivative)

    def by_constant(self, adjoint: np.ndarray, constant: Constant) -> float:
        """dN/dc, the derivative of a number in a constant."""
        return -float(np.vdot(adjoint, self.pull(constant)))

    def pull(self, constant: Constant) -> np.ndarray:
        """dF/dc, what a constant adds to the gradient of every free node by its unit; 0 on prescribed nodes.

        Raises:
            InputError: gravity and a rest state that was found for these constants (`sag_free`): it would move.
        """
        model = self.model
        if model.scan is not None:
            raise InputError(
                "sensitivities: constants also move the rest state that gravity pulls into the scan, which is not "
                "followed; leave the constants out, or take the scan as the rest state"
            )
        elements = model.elements
        weights = {
            name: model.array(values, getattr(elements, name).dtype)
            for name, values in weight_derivative(model, constant).items()
            if len(getattr(elements, name))
        }
        state = State(replace(model, elements=replace(elements, **weights)))
        state.displacement.assign(self._state.displacement)
        state.evaluate()
        gradient = state.gradient.numpy().astype(np.float64)
        gradient[model.prescribed] = 0.0
        return self._in_mesh_order(gradient)

    def follow(self, bones: np.ndarray | None, pull: np.ndarray | None = None) -> np.ndarray:
        """How all nodes move when bones move by a little (their nodes count), and F changes by `pull` [mm]."""
        model = self.model
        force, moved = np.zeros((model.free_nodes, 3)), np.zeros((model.nodes, 3))
        if bones is not None:
            held = moved[model.prescribed] = self._in_model_order(bones)[model.prescribed]
            if model.free_nodes:
                force -= self._coupling.times(held)
        if pull is not None:
            force -= self._in_model_order(pull)[model.free]
        moved[model.free] = self._solve(force)
        return self._in_mesh_order(moved)

    def _solve(self, force: np.ndarray) -> np.ndarray:
        """x with H x = force, both (free, 3)."""
        size = float(np.abs(force).max(initial=0.0))
        if size == 0.0:
            return np.zeros_like(force)
        self._load.assign(-force / size)
        solution = self._solver.solve(0.0, self._accuracy, 0)
        self.iterations += solution.iterations
        if solution.bent or solution.iterations >= MOST_ITERATIONS or not np.isfinite(solution.longest):
            raise InputError(
                "sensitivities: the trunk is at no stable equilibrium, or too near the end of one; "
                "simulate with a smaller tolerance"
            )
        return size * self._solver.solution.numpy().astype(np.float64)

    def _in_model_order(self, field: np.ndarray) -> np.ndarray:
        return field[self.model.order]

    def _in_mesh_order(self, field: np.ndarray) -> np.ndarray:
        result = np.zeros((self.model.nodes, 3))
        result[self.model.order[: len(field)]] = field
        return result
