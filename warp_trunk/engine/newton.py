"""The projected loop of a relaxation: evaluate, assemble, precondition, solve, line search, accept, judge.

Projection is the range of the launches: every step is taken over the free nodes of the model, so a node on bone
never moves by a bit (the mappings U of eq. 4.3 of [2]). The loop stops by an estimated distance in mm, or says why
not."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import warp as wp

from warp_trunk.kernels.assembly import COLUMNS
from warp_trunk.kernels.vectors import vector_kernels

from .certify import ACCURACY, SLOWEST, Certificate, Step
from .history import ROUNDING, History
from .line_search import Proposal, Trial, search
from .linear import BlockMatrix, ConjugateGradient, LinearSolution
from .model import Model
from .multigrid import Multigrid
from .parallel import Launch, Readback, takes_turns
from .relaxation import Relaxation, RelaxOptions, RelaxStatus, RelaxStep
from .state import ProductReader, Products, State, longest

ROUNDING_STEPS = 10.0
"""Roundings of the largest displacement that a force summed over a node's tetrahedra may hide."""


class Relaxer:
    """Everything a relaxation needs on the device, made once for a model with free nodes."""

    state: State
    """The configuration that holds: set it, relax it, read it. Its arrays stay the same."""

    user: object | None = None
    """The simulation that it relaxes for: the last that began."""

    @takes_turns
    def __init__(self, model: Model, options: RelaxOptions | None = None) -> None:
        """Builds matrix, preconditioner and solvers; the trunk is at rest, or where it was scanned."""
        self.model = model
        self.options = options or RelaxOptions()
        self.state = State(model)
        if not model.free_nodes:
            return
        self._trial = State(model, start=self.state)
        self._newton = Newton(self.state)
        direction = self._newton.direction
        self._products = ProductReader(self.state, direction, self.state.gradient)
        self._trial_products = ProductReader(self._trial, direction, self.state.gradient)
        self._length = model.zeros(wp.float64, 1)
        longest = model.zeros(wp.float64, model.parallel.ranges, COLUMNS)
        self._longest = Readback(model.parallel, longest)
        kernels = vector_kernels(*model.variant)
        self._step, whole_step = (
            model.over_free(kernels.step, [length, self.state.displacement, direction], [self._trial.displacement])
            for length in (self._length, model.array(np.ones(1), wp.float64))
        )
        find_longest = model.over_nodes(kernels.longest, [self.state.displacement], [longest])
        graph, measure = model.parallel.graph, (longest.zero_, find_longest, self._longest.send)
        copy_prescribed = partial(wp.copy, self._trial.displacement, self.state.displacement)  # no step moves them
        self._measure = graph(*measure)
        self._evaluate = graph(self.state.evaluate, *measure, copy_prescribed)
        self._accept = graph(partial(self.state.copy_from, self._trial))
        self._ahead = SpeculativeTrial(
            graph(self._products.launch, whole_step, self._trial.evaluate, self._trial_products.launch)
        )

    @takes_turns
    def assemble_true(self, displacement: wp.array) -> tuple[BlockMatrix, Multigrid]:
        """The true Hessian at a displacement from rest, and a preconditioner of it, until the next relaxation.

        The model must have free nodes. `state` is then at that displacement.
        """
        self.state.displacement.assign(displacement)
        return self._newton.assemble_true()

    @takes_turns
    def relax(
        self,
        tolerance: float | None = None,
        watch: Callable[[RelaxStep, State], None] | None = None,
        *,
        confirm: bool = True,
        near: bool = False,
        reuse: bool = False,
        meanwhile: Callable[[], None] | None = None,
    ) -> Relaxation:
        """Relaxes `state` until it is known to be nearer to an equilibrium, no saddle, than the tolerance [mm].

        The energy falls at every accepted step, no tetrahedron is inverted that was not inverted at the start
        unless the energy rights inverted ones, and the number of steps is bounded. `watch` is called after each
        accepted step with the state, to read and not to change. Without `confirm` it ends, NEAR, as soon as the
        distance before the last step is estimated to be below the tolerance: increments on the way need not be
        known so well. `near` promises that the state is likely some tolerances from its end,
        which saves work where it is so; `reuse`, that it is near the one whose Hessian was assembled last.
        `meanwhile` is called while a device is at work."""
        tolerance = self.options.tolerance if tolerance is None else tolerance
        newton = self._newton if self.model.free_nodes else None
        if newton is not None:
            self._evaluate()
            newton.begin(tolerance, confirm=confirm, near=near, reuse=reuse)
            self._launch_step(newton, None, 0.0)
        else:
            self.state.evaluate()
        if meanwhile is not None:
            meanwhile()
        energy, inverted, _ = self.state.read()
        history = History(energy, inverted, ROUNDING[self.model.precision])
        if not math.isfinite(energy.total):
            return history.end(RelaxStatus.NOT_FINITE, math.inf)
        if newton is None:
            return history.end(RelaxStatus.CONVERGED, 0.0)
        newton.floor = self._floor()
        products, length = None, 0.0
        for _step in range(self.options.max_steps):
            # Solve: the direction to the equilibrium, and the length to try first.
            proposal = newton.propose(products, length)
            spent = proposal.iterations
            history.linear_iterations += spent
            if history.stagnated(newton.distance):
                return history.end(RelaxStatus.STALLED, newton.distance)
            # Line search: a length that lowers the energy and inverts nothing that must not be inverted.
            if not proposal.is_solution:
                self._ahead.drop()
            here = self._products_here()
            trial, attempts = search(
                self._attempt,
                proposal.length,
                history.energy.total,
                here.slope,
                newton.slope_ratio,
                rounding=history.rounding,
            )
            history.evaluations += attempts
            if trial is not None:
                self._accept()
                products, length = trial.products, trial.length
            # Judge: how far the equilibrium can be from here.
            arrived, more = newton.judge(trial.length, trial.products) if trial else newton.judge(0.0, here)
            arrived = arrived and (not confirm or self._resolves(tolerance))
            history.linear_iterations += more
            if trial is not None:
                accepted = history.add(trial, newton.distance, spent + more)
                if watch is not None:
                    watch(accepted, self.state)
            if arrived:
                return history.end(RelaxStatus.CONVERGED if confirm else RelaxStatus.NEAR, newton.distance)
            if trial is None or newton.exhausted:
                if newton.exhausted or not newton.retry():
                    return history.end(RelaxStatus.STALLED, newton.distance)
                products = None
            # Evaluate, assemble and precondition at the accepted state.
            self._launch_step(newton, products, length)
        return history.end(RelaxStatus.STEP_LIMIT, newton.distance)

    def estimate_distance(self) -> tuple[float, int]:
        """Solves for the Newton step at the state as it was evaluated, of a model with free nodes.

        Returns:
            Its length, which estimates how far the equilibrium is [mm], and the linear iterations.
        """
        newton = self._newton
        newton.begin(0.0, 0.0)
        iterations = newton.propose(None, 1.0).iterations
        return newton.distance, iterations

    def _launch_step(self, newton: Newton, products: Products | None, length: float) -> None:
        """Assembles, preconditions and launches the solve of a step; on CUDA with the trial at its end."""
        if newton.launch(products, length) and self.model.parallel.is_cuda:
            self._ahead.launch()

    def _resolves(self, tolerance: float) -> bool:
        """Whether the distance is within the tolerance also with the rounding of where the nodes are now."""
        newton = self._newton
        self._measure()
        grown = max(0.0, self._floor() - newton.floor)
        newton.floor, newton.distance = newton.floor + grown, newton.distance + grown
        return newton.distance <= tolerance

    def _floor(self) -> float:
        """Rounding error of every distance [mm], by the largest displacement when it was last measured."""
        largest = float(self._longest.read().max()) ** 0.5
        return ROUNDING_STEPS * float(np.finfo(self.model.precision).eps) * largest

    def _products_here(self) -> Products:
        """Products at the state with the direction that was proposed."""
        if not self._ahead.pending:
            self._products.launch()
        return self._products.read()

    def _attempt(self, length: float) -> Trial:
        """Evaluates the trial at a length along the direction."""
        if not self._ahead.take(length):
            self._length.fill_(length)
            self._step()
            self._trial.evaluate()
            self._trial_products.launch()
        return Trial.read(length, self._trial, self._trial_products)


class SpeculativeTrial:
    """The trial at the whole Newton step, launched before the host has read how the solve ended.

    A device that waits for a question is idle. The trial is dropped where the direction becomes another one.
    """

    pending: bool = False
    """Whether a trial was launched that is neither taken nor dropped."""

    def __init__(self, launch: Launch) -> None:
        """`launch` evaluates the products at the state, and the trial at length 1."""
        self._launch = launch

    def launch(self) -> None:
        """Launches the trial at the end of the direction that is being solved for."""
        self._launch()
        self.pending = True

    def take(self, length: float) -> bool:
        """Whether the trial at this length was launched ahead; it is taken once."""
        taken, self.pending = self.pending and length == 1.0, False
        return taken

    def drop(self) -> None:
        """The direction is another than the one that was solved for."""
        self.pending = False


ON_THE_WAY = 0.03
"""The part of the tolerance that a solve may leave at increments on the way: the extrapolation builds on them."""
PROJECTED_ACCURACY = 0.3
"""The part of the distance that a solve with the projected Hessian may leave. Such a step leaves more where tissue
is crushed: solves to a tenth took as many steps, and a third more iterations. Where volume is a thousand times as
stiff as usual they took a fifth of the iterations."""
TRUE_ACCURACY, LOOSEST = 0.03, 0.1
"""The part of the distance that a solve with the true Hessian may leave: the square of the contraction of the last
step, between these (Eisenstat and Walker 1996)."""
IMPROVING = 0.9
"""A step that left at most this part of the gradient is followed by another before noise is solved for in vain."""
CONTRACTION = 0.2
"""A step that leaves more than this part of the distance calls for the Hessian of where it led."""
FIRST = 2.0 / 3.0
"""The part of the distance that the first step of a relaxation is assumed to leave: its Hessian, projected, is too
stiff where edges are compressed, and no step has been seen yet."""
NEAR = 20.0
"""Distance from the equilibrium in tolerances at which the true Hessian takes over to confirm the end."""
WELL_SHAPED, WITHIN = 0.3, 3.0
"""It takes over within this many mm, or tolerances: beyond, crushed tissue has negative curvature."""
NEARER = 0.25
"""The part of the distance to which the projected Hessian leads before the true one, found indefinite, is tried
again."""
CLOSE = 10.0
"""A step of at most this many tolerances along the true Hessian may have ended within one of them."""
REACH = 10.0
"""A descent from a saddle is first tried as far as this many tolerances."""


class Newton:
    """Truncated Newton: the direction that solves H d = -g as far as it pays, and how far the equilibrium is.

    The direction is the vector to the equilibrium, as far as the linear solve and the Hessian go, so the length of
    its longest arrow is the distance [mm]. The Hessian is that of an earlier step as long as the steps shrink
    fast. Once the line search had to cut a step, solves no longer end early: stiff motions then hide soft ones,
    and a short solve of what a step along the soft ones left would look converged.

    Far away the Hessian is projected to a positive semidefinite one, so that every direction descends; it is
    stiffer than the truth, and its steps are shorter than the way to go. Where the end is to be confirmed, the
    true one takes over near it. If that is negative along some direction, the step descends along it (Steihaug
    1983)."""

    distance: float
    """How far the equilibrium is estimated to be [mm]; infinite where a direction leads down from a saddle."""
    negative_curvature: bool
    """Whether the last solve with the true Hessian met negative curvature."""
    exhausted: bool
    """Whether the last judgement had to be given up, so that another one would be in vain."""
    floor: float
    """Rounding error of every distance [mm]; set before the first direction is read."""

    def __init__(self, state: State) -> None:
        """For a state at rest: the preconditioner is made of the Hessian there."""
        self._state, self._true = state, False
        self._matrix = BlockMatrix(state)
        self._preconditioner = Multigrid(self._matrix)
        graph = state.model.parallel.graph
        self._assemble_projected = graph(self._matrix.assemble_projected)
        self._assemble_true = graph(self._matrix.assemble_true)
        self._solver = ConjugateGradient(self._matrix, self._preconditioner, state.gradient)
        self._certificate = Certificate(state, self._matrix, self._preconditioner)
        self.begin(math.inf, 0.0)

    @property
    def direction(self) -> wp.array:
        """d [mm], shape (free,), vec3."""
        return self._solver.solution

    @property
    def slope_ratio(self) -> float | None:
        """The line search takes the first decrease of a Newton step; down from a saddle it looks farther."""
        return 0.5 if math.isinf(self.distance) else None

    def begin(
        self, tolerance: float, floor: float = 0, *, confirm: bool = False, near: bool = False, reuse: bool = False
    ) -> None:
        """Begins a relaxation to a tolerance, where rounding leaves `floor` of every distance [mm].

        With `confirm` its end is to be confirmed; `near`, it begins some tolerances from there; `reuse` takes the
        Hessian assembled last, if that is projected.
        """
        self._shrink = 0.0 if reuse and not self._true else math.inf
        self._tolerance, self.floor = tolerance, floor
        self._true_within = min(NEAR * tolerance, max(WITHIN * tolerance, WELL_SHAPED))
        self._at_saddle = False
        self._confirm, self._starts_near = confirm, near
        self._longest_solve = 0
        self._cut = self._true = self._first_true = self._consecutive = self._launched = False
        self._length = self._contraction = math.inf
        self._norm = 0.0
        self._down: np.ndarray | None = None
        self.distance, self.exhausted, self.negative_curvature = math.inf, False, False
        self._certificate.begin()

    def assemble_true(self) -> tuple[BlockMatrix, Multigrid]:
        """The matrix, set to the true Hessian at the state, and the preconditioner."""
        self._assemble_projected()
        self._assemble_true()
        return self._matrix, self._preconditioner

    def retry(self) -> bool:
        """Whether there is another direction at the same state: down from a saddle, or the first true one."""
        if self._down is not None:
            return True
        self._true_within, self._at_saddle = NEAR * self._tolerance, True
        return not self._true and self._is_near

    @property
    def _is_near(self) -> bool:
        return self._confirm and (self._starts_near or self.distance <= self._true_within)

    def launch(self, products: Products | None, last_length: float) -> bool:
        """Assembles where it pays and launches the solve that `propose` then reads; returns whether there is one.

        Args:
            products: those of the last trial; None where no step led here.
            last_length: the part of the last direction that was taken.
        """
        if self._down is not None:
            return False
        whole = products is not None and last_length == 1.0
        self._cut = self._cut or (products is not None and last_length < 1.0 and self.distance < math.inf)
        was_true, self._true = self._true, self._is_near
        if self._true != was_true or not self._shrink <= CONTRACTION:
            (self._assemble_true if self._true else self._assemble_projected)()
        self._first_true, self._starts_near = self._starts_near, False
        relative = min(LOOSEST, max(TRUE_ACCURACY, self._contraction**2)) if self._true else PROJECTED_ACCURACY
        absolute = (ACCURACY if self._confirm else ON_THE_WAY) * self._tolerance
        self._solver.launch(absolute, relative, self._longest_solve if self._cut else 0)
        self._launched, self._consecutive = True, whole and was_true and self._true
        return True

    def propose(self, products: Products | None, last_length: float) -> Proposal:
        """Reads the solve that was launched and sets direction and distance."""
        if self._down is not None:
            self._descend_saddle(np.zeros_like(self._down), self._down)
            return Proposal(1.0)
        if not self._launched:
            self.launch(products, last_length)
        self._launched = False
        solution = self._solver.read()
        self._longest_solve = max(self._longest_solve, solution.iterations)
        self.negative_curvature = self._true and solution.negative_curvature
        if self.negative_curvature and (self._first_true or not self._at_saddle):  # not as near as expected
            self._true_within = min(self._true_within, NEARER * self.distance)
            self._at_saddle = self._true_within <= self._tolerance
            self.distance = math.inf
            more = self.propose(None, 1.0).iterations  # of the projected Hessian
            self.negative_curvature = True
            return Proposal(1.0, solution.iterations + more)
        if self.negative_curvature:
            self._descend_saddle(self._solver.solution.numpy(), self._solver.search.numpy())
            return Proposal(1.0, solution.iterations)
        if self._true and math.isinf(solution.length):  # the preconditioner was made too far away
            self.distance = math.inf
            return Proposal(1.0, solution.iterations + self.propose(None, 1.0).iterations)
        last = self._last_step(solution.norm)
        self._estimate(solution)
        if self._consecutive:
            self._certificate.add(Step(last.length, max(last.left, self._length)))
        return Proposal(1.0, solution.iterations, is_solution=True)

    def _estimate(self, solution: LinearSolution) -> None:
        """Sets the distance by the length of a direction and how much shorter it is than the one before."""
        length = solution.length + solution.error
        self._shrink = length / self._length if 0.0 < self._length < math.inf else math.inf
        shrink = min(self._shrink, SLOWEST) if self._length < math.inf else FIRST
        self._length, self._norm, self._contraction = length, solution.norm, self._shrink
        self.distance = self.floor + length * max(1.0, shrink / (1.0 - shrink))

    def _last_step(self, norm: float) -> Step:
        """The last whole step by the gradient that it left, in the preconditioner's norm."""
        return Step(self._length, norm / self._norm * self._length if self._norm > 0.0 else 0.0)

    def _descend_saddle(self, start: np.ndarray, down: np.ndarray) -> None:
        """Sets the direction to a start and on along a direction of negative curvature, downwards."""
        gradient = self._state.gradient.numpy()[: len(down)].astype(float)
        sign = -1.0 if np.vdot(gradient, down) > 0.0 else 1.0
        reach = max(REACH * self._tolerance, longest(start)) / max(longest(down), 1e-300)
        self._solver.solution.assign((start + sign * reach * down).astype(down.dtype))
        self._length = self._shrink = self.distance = math.inf
        self._certificate.begin()
        self._down = None

    def judge(self, length: float, products: Products) -> tuple[bool, int]:
        """Whether the relaxation can end, and the linear iterations spent on that; sets `distance`.

        It can where the estimate is below the tolerance, or if that is to be confirmed, where the equilibrium is
        known to be so near.

        Args:
            length: the part of the direction that has led here from where it was found.
            products: those at the state.
        """
        if not self._confirm:
            return self.distance <= self._tolerance, 0
        if not self._true or self.floor + self._length > CLOSE * self._tolerance:
            return False, 0
        if length:
            self._assemble_true()
            self._shrink = 0.0  # the Hessian of here
        norm = self._solver.norm() if length else self._norm
        last = self._last_step(norm) if length == 1.0 else None
        if last is not None and last.length > self._tolerance and last.left > TRUE_ACCURACY * self._tolerance:
            return False, 0  # one more step costs less than to judge what this one left
        improving = length > 0.0 and norm <= IMPROVING * self._norm
        verdict = self._certificate.judge(
            self._tolerance, self.floor, products.gradient_squared, norm, last, improving=improving
        )
        self.distance, self.exhausted = verdict.distance, verdict.exhausted
        self._down = None if verdict.down is None else verdict.down.numpy()
        return verdict.distance <= self._tolerance, verdict.iterations
