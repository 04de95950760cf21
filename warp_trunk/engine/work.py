"""The work of a relaxation on its device: assemble, solve, try, accept. It decides nothing."""

from __future__ import annotations

from functools import partial

import numpy as np
import warp as wp

from warp_trunk.kernels.assembly import COLUMNS
from warp_trunk.kernels.node_groups import MEMBERS
from warp_trunk.kernels.vectors import vector_kernels

from .certify import chance_of_saddle, response
from .grids import Grids
from .line_search import Trial
from .linear import BlockMatrix, ConjugateGradient, LinearSolution, zero_dots
from .multigrid import Multigrid
from .parallel import Readback
from .policy import POLICY, PlannedSolve
from .state import ProductReader, Products, State, longest

ROUNDING_STEPS = 10.0
"""Roundings of the largest displacement that a force summed over a node's tetrahedra may hide."""


class Work:
    """The state of a relaxation with its Hessian, preconditioner, solver and trial."""

    matrix: BlockMatrix
    """The Hessian that was assembled last."""
    hessian: tuple[bool, int] | None = None
    """Whether that is the true one, and the version of the state that it was assembled at; None: at rest."""
    evaluations: int
    """Evaluations of energy and gradient since the state was last set."""

    def __init__(self, state: State, grids: Grids | None = None) -> None:
        """For a state at rest, or where the trunk was scanned: the preconditioner is made of the Hessian there.

        For `grids` see `Relaxer`.
        """
        self.state, model = state, state.model
        self.matrix = BlockMatrix(state)
        self.preconditioner = Multigrid(self.matrix, grids)
        self._trial, self._version = State(model, start=state), 0
        kernels, graph = vector_kernels(model.scalar), model.parallel.graph
        self._assemble_projected = graph(self.matrix.assemble_projected, self.preconditioner.update)
        self._assemble_true = graph(self.matrix.assemble_true)
        self._solver = ConjugateGradient(self.matrix, self.preconditioner, state.gradient)
        self.direction, self._noise = self._solver.solution, 0.0
        white = model.array(np.random.default_rng(0).standard_normal((model.free_nodes, 3)), model.vec3)
        self._color = model.over_free(kernels.color, [self.matrix.inverse_diagonal, white], [self._solver.noise])
        # how far noise moves the direction
        inverse = np.trace(self.matrix.inverse_diagonal.numpy().astype(float), axis1=1, axis2=2)
        self._stiffness = float((3.0 / inverse).mean())
        before, change = model.free_vectors(), model.free_vectors()
        most, back = model.zeros(wp.float64, model.parallel.ranges, COLUMNS), model.array(-np.ones(1), wp.float64)
        self._keep_direction = partial(wp.copy, before, self.direction)
        self._change = Readback(model.parallel, most)
        self._find_change = graph(
            model.over_free(kernels.step, [back, self.direction, before], [change]),
            most.zero_,
            model.over_free(kernels.longest, [change], [most]),
            self._change.send,
        )
        self._grids_at_rest = True
        self._curved, curvature = model.free_vectors(), zero_dots(model)
        self._multiply = self.matrix.multiply(self._curved, model.free_vectors(), curvature)
        self._curvature, self._clear_curvature = (
            Readback(model.parallel, curvature.products),
            curvature.products.zero_,
        )
        # the trial along the direction
        self._length = model.zeros(wp.float64, 1)
        self._products = ProductReader(state, self.direction, state.gradient)
        self._trial_products = ProductReader(self._trial, self.direction, state.gradient)
        self._step, whole_step = (
            model.over_free(kernels.step, [length, state.displacement, self.direction], [self._trial.displacement])
            for length in (self._length, model.array(np.ones(1), wp.float64))
        )
        self._try_ahead = graph(
            self._products.launch, whole_step, self._trial.evaluate, self._trial_products.launch
        )
        self._ahead = False
        self._accept = graph(partial(state.copy_from, self._trial))
        # evaluation, with the largest displacement
        largest = model.zeros(wp.float64, model.parallel.ranges, COLUMNS)
        self._largest = Readback(model.parallel, largest)
        find_largest = model.parallel.record(kernels.longest, model.nodes, [state.displacement], [largest])
        copy_prescribed = partial(wp.copy, self._trial.displacement, state.displacement)  # no step moves them
        measure = (largest.zero_, find_largest, self._largest.send)
        self._measure = graph(*measure)
        self._evaluate = graph(state.evaluate, *measure, copy_prescribed)

    def evaluate(self) -> None:
        """Evaluates the state, which was set to another displacement."""
        if not self._grids_at_rest:  # nothing that a relaxation learnt survives it
            self.preconditioner.reset_grids()
            self._grids_at_rest = True
        self._evaluate()
        self._version, self._ahead, self.evaluations = self._version + 1, False, 1

    def floor(self) -> float:
        """Rounding error of every distance [mm], by the largest displacement when that was last measured."""
        largest = float(self._largest.read().max()) ** 0.5
        return ROUNDING_STEPS * float(np.finfo(self.state.model.precision).eps) * largest

    def measure(self) -> float:
        """The rounding error of distances at the state as it is now."""
        self._measure()
        return self.floor()

    def assemble(self, *, true: bool, fresh: bool = True, grids: bool = False) -> None:
        """Sets the matrix to the Hessian of the state; if not `fresh`, where it is not the last of its kind.

        With `grids`, the preconditioner's grids follow it.
        """
        now = true, self._version
        if self.hessian is None or (self.hessian != now and (self.hessian[0] != true or fresh)):
            (self._assemble_true if true else self._assemble_projected)()
            self.hessian = now
        if grids:
            self._grids_at_rest = False  # first: it may be interrupted
            self.preconditioner.update_grids()

    def launch(self, planned: PlannedSolve, *, ahead: bool = False) -> None:
        """Begins a planned solve; on CUDA with `ahead`, the trial at the end of it.

        A device that waits for the host is idle; the trial is dropped where the direction becomes another one.
        """
        self._solver.launch(planned.absolute, planned.relative, planned.least_iterations, short=planned.short)
        self._ahead = ahead and self.state.model.parallel.is_cuda
        if self._ahead:
            self._try_ahead()

    def read(self) -> LinearSolution:
        """How the solve that was launched ended."""
        return self._solver.read()

    def certify(self, solution: LinearSolution) -> LinearSolution:
        """Continues a solve with noise as large as what it left."""
        model = self.state.model
        least = POLICY.least_noise * float(np.finfo(model.precision).eps)
        self._noise = max(solution.left / max(3 * model.free_nodes, 1) ** 0.5, least)
        self._ahead = False
        self._keep_direction()
        self._color()
        return self._solver.add_noise(self._noise)

    def chances(self) -> tuple[float, float]:
        """Of having missed a saddle, after the first iteration of the last solve, with noise, and after all."""
        rounding = POLICY.rounding * float(np.finfo(self.state.model.precision).eps)
        noise = self._noise / MEMBERS**0.5  # the block of a group is at most MEMBERS times its diagonal
        r_dot_z, p_dot_q = self._solver.coefficients()
        first = chance_of_saddle(r_dot_z[:1], p_dot_q[:1], noise, rounding)
        return first, chance_of_saddle(r_dot_z, p_dot_q, noise, rounding)

    def hidden(self) -> tuple[float, float]:
        """How far noise and rounding of forces may have moved the solution along the softest direction [mm]."""
        r_dot_z, p_dot_q = self._solver.coefficients()
        noise = float(r_dot_z[0] / (3 * self.state.model.free_nodes)) ** 0.5
        rounding = POLICY.rounding_of_forces * self.floor() * self._stiffness**0.5
        self._find_change()
        unit = POLICY.deviations * response(r_dot_z, p_dot_q) * float(self._change.read().max()) ** 0.5
        return noise * unit, rounding * unit

    def go_on(self, iterations: int) -> LinearSolution:
        """Continues the last solve to so many iterations in all."""
        return self._solver.go_on(iterations)

    def negative_curvature(self) -> np.ndarray:
        """The search direction at which the last solve ended, shape (free nodes, 3)."""
        return self._solver.search.numpy().copy()

    def curvature(self, along: np.ndarray) -> float:
        """v . H v with the matrix as it is."""
        self._curved.assign(along)
        self._clear_curvature()
        self._multiply()
        self._curvature.send()
        return float(self._curvature.read().sum())

    def descend(self, down: np.ndarray, reach: float, *, on: bool) -> None:
        """Sets the direction to one of negative curvature, downwards, so far [mm]; `on` from the solution."""
        start = self.direction.numpy() if on else np.zeros_like(down)
        gradient = self.state.gradient.numpy()[: len(down)].astype(float)
        sign = -1.0 if np.vdot(gradient, down) > 0.0 else 1.0
        scale = sign * max(reach, longest(start)) / max(longest(down), 1e-300)
        self.direction.assign((start + scale * down).astype(down.dtype))
        self._ahead = False

    def turn_downhill(self) -> None:
        """Turns the direction round where the energy rises along it."""
        if self.products().slope > 0.0:
            self.direction.assign(-self.direction.numpy())

    def products(self) -> Products:
        """Products of the gradient at the state with the direction."""
        if not self._ahead:
            self._products.launch()
        return self._products.read()

    def attempt(self, length: float) -> Trial:
        """Evaluates the trial at a length along the direction."""
        ahead, self._ahead = self._ahead and length == 1.0, False
        self.evaluations += 1
        if not ahead:
            self._length.fill_(length)
            self._step()
            self._trial.evaluate()
            self._trial_products.launch()
        return Trial.read(length, self._trial, self._trial_products)

    def accept(self) -> None:
        """The state becomes the trial that was evaluated last."""
        self._accept()
        self._version += 1
