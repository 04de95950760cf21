"""The work of a relaxation on its device: assemble, solve, try, accept. It decides nothing."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import warp as wp

from warp_trunk.kernels.vectors import vector_kernels

from .certify import Certificate
from .grids import Grids
from .line_search import Trial
from .linear import BlockMatrix, ConjugateGradient, zero_dots
from .multigrid import Multigrid
from .outcome import LinearSolution
from .parallel import nothing
from .policy import PlannedSolve
from .state import MatrixState, ProductReader, Products, State, longest


class Work:
    """The state of a relaxation with its Hessian, preconditioner, solver, certificate and trial."""

    matrix: BlockMatrix
    """The Hessian that was assembled last."""
    matrix_state: MatrixState
    """Which one that is."""
    direction: wp.array
    """The solution of the last solve, or what was put in its place [mm], shape (free nodes,), vec3."""
    evaluations: int
    """Evaluations of energy and gradient since the state was last set."""

    def __init__(self, state: State, grids: Grids | None = None) -> None:
        """For a state at rest, or where the trunk was scanned: the preconditioner is made of the Hessian there.

        For `grids` see `Relaxer`.
        """
        self.state, graph = state, state.model.parallel.graph
        self.matrix, self.matrix_state = BlockMatrix(state), MatrixState()
        self.matrix.assemble_projected()
        self.preconditioner = Multigrid(self.matrix, grids)
        self._assemble_projected = graph(self.matrix.assemble_projected, self.preconditioner.update)
        self._assemble_true = graph(self.matrix.assemble_true)
        self.solver = ConjugateGradient(self.matrix, self.preconditioner, state.gradient)
        self.direction = self.solver.solution
        self.certificate = Certificate(self.matrix, self.solver, self.preconditioner.groups.members)
        self._curved, self._product = state.model.free_vectors(), state.model.free_vectors()
        self._multiply = self.matrix.multiply(self._curved, self._product, zero_dots(state.model))
        self._record_trial()

    def _record_trial(self) -> None:
        """A point along the direction."""
        state, model = self.state, self.state.model
        self._trial, self._length = State(model, start=state), model.zeros(wp.float64, 1)
        self._products = ProductReader(state, self.direction, state.gradient)
        self._trial_products = ProductReader(self._trial, self.direction, state.gradient)
        point = [self._length, state.displacement, self.direction]
        step = model.over_free(vector_kernels(model.scalar).step, point, [self._trial.displacement])
        self._try = model.parallel.graph(step, self._trial.evaluate, self._trial_products.launch)
        self._accept = model.parallel.graph(partial(state.copy_from, self._trial))
        copy_prescribed = partial(wp.copy, self._trial.displacement, state.displacement)  # no step moves them
        self._evaluate = model.parallel.graph(state.evaluate, copy_prescribed)

    def evaluate(self) -> None:
        """Evaluates the state, which was set to another displacement."""
        if self.matrix_state.grids_follow:  # nothing that a relaxation learnt survives it
            self.preconditioner.reset_grids()
            self.matrix_state.grids_follow = False
        self._evaluate()
        self.evaluations = 1

    def assemble(self, *, true: bool, fresh: bool = True, grids: bool = False) -> None:
        """Sets the matrix to the Hessian of the state; if not `fresh`, where it is not the last of its kind.

        With `grids`, the preconditioner's grids follow it.
        """
        if not self.matrix_state.holds(true, self.state.version if fresh else None):
            self.matrix_state.version = None  # first: it may be interrupted
            (self._assemble_true if true else self._assemble_projected)()
            self.matrix_state.true, self.matrix_state.version = true, self.state.version
        if grids:
            self.matrix_state.grids_follow = True  # likewise
            self.preconditioner.update_grids()

    def solve(self, planned: PlannedSolve, meanwhile: Callable[[], None] = nothing) -> LinearSolution:
        """Assembles what is planned and solves for the direction; `meanwhile` is called while a device does."""
        self.assemble(true=planned.true, fresh=planned.fresh, grids=planned.grids)
        return self.solver.solve(
            planned.absolute,
            planned.relative,
            planned.least_iterations,
            short=not planned.true,
            meanwhile=meanwhile,
        )

    def negative_curvature(self) -> np.ndarray:
        """The search direction at which the last solve ended, shape (free nodes, 3)."""
        return self.solver.search.numpy().copy()

    def curvature(self, along: np.ndarray) -> float:
        """v . H v with the matrix as it is [energy's unit], for v of shape (free nodes, 3) [mm]."""
        self._curved.assign(along)
        self._multiply()
        return float(np.vdot(along.astype(np.float64), self._product.numpy()))

    def descend(self, down: np.ndarray, reach: float, *, on: bool) -> None:
        """Sets the direction to one of negative curvature, downwards, so far [mm]; `on` from the solution."""
        start = self.direction.numpy() if on else np.zeros_like(down)
        gradient = self.state.gradient.numpy()[: len(down)].astype(float)
        sign = -1.0 if np.vdot(gradient, down) > 0.0 else 1.0
        scale = sign * max(reach, longest(start)) / max(longest(down), 1e-300)
        self.direction.assign((start + scale * down).astype(down.dtype))

    def turn_downhill(self) -> None:
        """Turns the direction round where the energy rises along it."""
        if self.products().slope > 0.0:
            self.direction.assign(-self.direction.numpy())

    def products(self) -> Products:
        """Products of the gradient at the state with the direction."""
        self._products.launch()
        return self._products.read()

    def attempt(self, length: float) -> Trial:
        """Evaluates the trial at a length along the direction, as a part of it."""
        self.evaluations += 1
        self._length.fill_(length)
        self._try()
        return Trial.read(length, self._trial, self._trial_products)

    def accept(self) -> None:
        """The state becomes the trial that was evaluated last."""
        self._accept()
        self.state.version += 1
