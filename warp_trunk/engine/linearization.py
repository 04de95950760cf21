"""A trunk linearised at an equilibrium: what its numbers depend on, and how its tissue follows small changes.

At an equilibrium the gradient of the free nodes vanishes, F(u; b, c) = 0 for the displacement u of free nodes, b
of prescribed ones and constants c. Small changes keep it so: H du = -(dF/db db + dF/dc dc) with the true Hessian
H = dF/du. A number N(u) therefore changes by dN = -l . (dF/db db + dF/dc dc), where H l = dN/du: one linear solve
for the number (its adjoint l) gives its derivative in everything, since H is symmetric.

Of a solve that ends early, dN/du - H l is left. With any guess v of how the free nodes follow, the change of N is
(dN/du - H l) . v - l . (dF/db db + dF/dc dc): exact where l or v is, and otherwise wrong by the product of what
both lack (a dual-weighted residual, Becker and Rannacher 2001).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ParamSpec, TypeVar

import numpy as np

from warp_trunk.errors import InputError

from .constants import STIFFNESS, Constant, weight_derivative
from .coupling import Coupling
from .linear import ConjugateGradient, zero_dots
from .model import Model
from .newton import Relaxer
from .outcome import Outcome
from .relaxation import RelaxStatus
from .rest_derivative import rest_force_derivative, rest_motions
from .simulation import Increment
from .state import State

P = ParamSpec("P")
R = TypeVar("R")
ACCURACY = 3e-4
"""Part of the longest vector of a solution by which any of its vectors may be wrong; derivatives of the anatomy in
its landmarks are then right to 0.2 %. With 1e-3 one in the thickness of a layer was wrong by 5 %."""
MOST_ITERATIONS = 2000
"""Of one linear solve; many times what a stable equilibrium takes."""


@dataclass(frozen=True, eq=False)
class Adjoints:
    """Of some numbers N, in mesh order, shape (numbers, nodes, 3) each and 0 on prescribed nodes."""

    fields: np.ndarray
    """l with H l = dN/du."""
    residual: np.ndarray
    """dN/du - H l, which the solves left."""


class Linearization:
    """The linear problem at the end of a relaxation; fields are in mesh order, shape (fields, nodes, 3)."""

    iterations: int
    """Products with the Hessian so far."""

    def __init__(
        self,
        model: Model,
        increment: Increment,
        accuracy: float = ACCURACY,
        relaxer: Relaxer | None = None,
        *,
        unconfirmed: bool = False,
    ) -> None:
        """Assembles the true Hessian at the increment.

        Args:
            model: the trunk.
            increment: one of a simulation of it.
            accuracy: part of the longest vector of a solution by which a vector may be wrong.
            relaxer: one of this model, whose matrix and preconditioner are used. When it relaxes again this can no
                longer be used. Made when left out.
            unconfirmed: also where no equilibrium was found; `newton_correction` says how far it is.

        Raises:
            InputError: otherwise, a relaxation that did not converge: what is no equilibrium has no derivative; or
                a relaxer that another user is at work with. So do all methods once another has used it.
        """
        if increment.relaxation.status is not RelaxStatus.CONVERGED and not unconfirmed:
            raise InputError(
                f"sensitivities: the relaxation must have ended with CONVERGED, not "
                f"{increment.relaxation.status.name}; simulate with more steps or a larger tolerance"
            )
        self.model, self._accuracy = model, accuracy
        self.iterations = 0
        self._relaxer = relaxer = relaxer or Relaxer(model)
        self._state, self._user = relaxer.state, relaxer.ownership.take()
        if model.free_nodes:
            self._in_turn(self._assemble, increment.from_rest)

    def _assemble(self, displacement: np.ndarray) -> None:
        """Assembles the true Hessian at a displacement from rest, shape (nodes, 3), and makes a solver with it."""
        model = self.model
        matrix, preconditioner = self._relaxer.assemble_true(model.array(displacement, model.vec3))
        self._coupling = Coupling(self._state)
        self._right_side, self._guess, self._product = (model.free_vectors() for _ in range(3))
        self._multiply = matrix.multiply(self._guess, self._product, zero_dots(model))
        self._solver = ConjugateGradient(matrix, preconditioner, self._right_side, MOST_ITERATIONS)

    def _in_turn(self, function: Callable[P, R], *arguments: P.args, **named: P.kwargs) -> R:
        """Calls a function that uses the relaxer; refused once another has used it."""
        return self._relaxer.ownership.work(self._user, function, *arguments, **named)

    def newton_correction(self) -> np.ndarray:
        """From where the increment ended to the equilibrium, by the Hessian there [mm], shape (nodes, 3).

        A Newton step: where the tissue is caught at one place, it says what that leaves open everywhere else.
        """

        def gradient() -> np.ndarray:
            self._state.evaluate()
            return self._state.gradient.numpy()[self.model.free].astype(np.float64)

        force = self._in_mesh_order(self._in_turn(gradient))[None]
        return self.follow(np.zeros_like(force), force)[0]

    def adjoints(self, weights: np.ndarray) -> Adjoints:
        """Of numbers' derivatives in the place of every node, shape (numbers, nodes, 3)."""
        none = np.zeros((0, *weights.shape[1:]))
        return self.adjoints_and_follow(weights, none, none)[0]

    def adjoints_and_follow(
        self, weights: np.ndarray, bones: np.ndarray, force_derivatives: np.ndarray
    ) -> tuple[Adjoints, np.ndarray]:
        """`adjoints` and `follow` in one."""
        moved, force = bones[:, self.model.order], -self._of_free(force_derivatives)
        if self.model.free_nodes:
            force -= self._coupling.times(moved[:, self.model.prescribed])
        right = np.empty((len(weights) + len(force), self.model.free_nodes, 3), dtype=self.model.precision)
        right[: len(weights)], right[len(weights) :] = self._of_free(weights), force
        start = np.zeros_like(right)
        start[len(weights) :] = moved[:, self.model.free]
        solutions, residual = self._in_turn(self._solve, right, self._accuracy, start)
        moved[:, self.model.free] = solutions[len(weights) :]
        of_numbers = (self._in_mesh_order(each[: len(weights)]) for each in (solutions, residual))
        return Adjoints(*of_numbers), self._in_mesh_order(moved)

    def position_derivatives(self, adjoints: Adjoints) -> np.ndarray:
        """The derivatives of numbers in the places of prescribed nodes, dN/db, shape (numbers, nodes, 3).

        On free nodes they are what the adjoints left: to be multiplied with a guess of how these follow.
        """
        model, derivative = self.model, adjoints.residual.copy()
        if model.free_nodes:
            by_bones = -self._coupling.transposed_times(self._of_free(adjoints.fields))
            derivative[:, model.order[model.prescribed]] = by_bones
        return derivative

    def force_derivative(self, constant: Constant) -> np.ndarray:
        """dF/dc, what a constant adds to the gradient of every free node by its unit, shape (nodes, 3).

        dN/dc is therefore -l . dF/dc. It is 0 on prescribed nodes. A rest state that was found for the constants
        (`sag_free`) moves with them, which counts.
        """
        return self.force_derivatives([weight_derivative(self.model, constant)])[0]

    def force_derivatives(self, derivatives: Sequence[Mapping[str, np.ndarray]]) -> np.ndarray:
        """The same of several changes of the weights, shape (changes, nodes, 3).

        See `weight_derivative`, and `parts_derivative` where parts of tissues change in a mixture.
        """
        if not derivatives or not self.model.free_nodes:
            return np.zeros((len(derivatives), self.model.nodes, 3))
        return self._in_mesh_order(self._in_turn(self._force_derivatives, derivatives))

    def _force_derivatives(self, derivatives: Sequence[Mapping[str, np.ndarray]]) -> np.ndarray:
        """Those on the free nodes, shape (changes, free, 3)."""
        model, scan = self.model, self.model.scan
        end = self._state.displacement.numpy().copy()
        forces = np.array([self._force_derivative(each, end) for each in derivatives])
        if scan is not None:
            try:
                self._relaxer.assemble_true(model.array(scan, model.vec3))
                scan_forces = np.array([self._force_derivative(each, scan) for each in derivatives])
                moved = rest_motions(model, scan_forces, self._solve, self._accuracy)
            finally:
                self._relaxer.assemble_true(model.array(end, model.vec3))
            forces += [rest_force_derivative(model, end.astype(np.float64), each) for each in moved]
        return forces

    def _force_derivative(self, derivative: Mapping[str, np.ndarray], displacement: np.ndarray) -> np.ndarray:
        """The gradient of the energy with the derivative of its weights in their place, (free, 3)."""
        model = self.model
        elements, skin = model.elements, model.skin
        weights = {
            name: model.array(values, getattr(elements, name).dtype)
            for name, values in derivative.items()
            if name != STIFFNESS and len(getattr(elements, name))
        }
        if skin is not None:
            stiffness = derivative.get(STIFFNESS, np.zeros(len(skin.corners)))
            skin = replace(skin, stiffness=model.array(stiffness, model.scalar))
        state = State(replace(model, elements=replace(elements, **weights), skin=skin))
        state.set_from_rest(displacement)
        state.evaluate()
        return state.gradient.numpy()[model.free].astype(np.float64)

    def follow(self, bones: np.ndarray, force_derivatives: np.ndarray | None = None) -> np.ndarray:
        """How all nodes move when bones move by a little (their nodes count) and F by `force_derivatives` [mm].

        The values of `bones` at free nodes are where the solves start: the nearer to the answer, the sooner
        they end.
        """
        none = np.zeros((0, *bones.shape[1:]))
        return self.adjoints_and_follow(
            none, bones, np.zeros_like(bones) if force_derivatives is None else force_derivatives
        )[1]

    def _solve(
        self, force: np.ndarray, relative: float, guess: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """x with H x = force, each to a part of its longest vector, and what is left of force.

        All are of shape (fields, free, 3). One after the other: conjugate gradients that share the passes over the
        matrix between 16 right-hand sides took the whole command as long (`simulate --bands`, 45 right-hand
        sides)."""
        solutions, residual = np.zeros_like(force), np.zeros_like(force)
        if self.model.free_nodes:
            for number, right in enumerate(force):
                start = None if guess is None or not guess[number].any() else guess[number]
                solutions[number], residual[number] = self._solve_one(right, start, relative)
        return solutions, residual

    def _solve_one(
        self, force: np.ndarray, guess: np.ndarray | None, relative: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """The solution for one force (free, 3) and what is left of it; from a guess, the correction is solved
        for."""
        solver, absolute = self._solver, 0.0
        if guess is not None:
            self._guess.assign(guess.astype(self.model.precision))
            self._multiply()
            force = force - self._product.numpy()
            absolute = relative * float(np.linalg.norm(guess, axis=1).max())
        size = float(np.abs(force).max(initial=0.0))
        if not (size > 0.0 and np.isfinite(size)):
            size = 1.0  # float32 has a least and a greatest number
        self._right_side.assign((force * (-1.0 / size)).astype(self.model.precision))
        solution = solver.solve(absolute / size, relative)
        self.iterations += solution.iterations
        if solution.outcome is not Outcome.SOLVED:
            raise InputError(
                "sensitivities: the trunk is at no stable equilibrium, or too near the end of one; "
                "simulate with a smaller tolerance"
            )
        x, residual = solver.solution.numpy() * size, solver.residual.numpy() * size
        return (x if guess is None else x + guess), residual

    def _of_free(self, fields: np.ndarray) -> np.ndarray:
        return fields[:, self.model.order[self.model.free]]

    def _in_mesh_order(self, fields: np.ndarray) -> np.ndarray:
        """Of one field or several; nodes that are left out are 0."""
        result = np.zeros((*fields.shape[:-2], self.model.nodes, 3), dtype=fields.dtype)
        result[..., self.model.order[: fields.shape[-2]], :] = fields
        return result
