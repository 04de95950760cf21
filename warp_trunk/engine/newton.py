"""The loop of a relaxation by truncated Newton: solve, search along the line, accept, estimate the distance.

The direction is the vector to the equilibrium, as far as the linear solve and the Hessian go, so the length of
its longest arrow is the distance [mm]. Projection is the range of the launches: every step is taken over the
free nodes of the model, so a node on bone never moves by a bit (the mappings U of eq. 4.3 of [2]). What comes
next is decided in `policy`; `Work` alone knows the device."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace

import warp as wp

from .grids import Grids
from .history import History
from .line_search import MOST_TRIALS, search
from .linear import BlockMatrix
from .model import Model
from .multigrid import Multigrid
from .outcome import Outcome
from .ownership import Ownership
from .parallel import nothing, takes_turns
from .policy import Action, Reuse, Run, Saddle, judge_trial
from .relaxation import Relaxation, RelaxOptions, RelaxStatus, RelaxStep, check_tolerance
from .state import State
from .work import Work


class Relaxer:
    """Everything a relaxation needs on the device, made once for a model."""

    state: State
    """The configuration that holds: set it, relax it, read it. Its arrays stay the same."""

    work: Work | None
    """The work with it on the device; None where no node is free."""

    ownership: Ownership
    """Which simulation, linearization or relaxation uses it."""

    @takes_turns
    def __init__(self, model: Model, options: RelaxOptions | None = None, grids: Grids | None = None) -> None:
        """Builds matrix, preconditioner and solvers; the trunk is at rest, or where it was scanned.

        Args:
            model: the trunk.
            options: how to relax it.
            grids: those of the model from which it was `released`; laid, which takes most of the time, when left
                out.
        """
        self.model = model
        self.options = options or RelaxOptions()
        self.state = State(model)
        self.ownership = Ownership(self.state)
        self.work = Work(self.state, grids) if model.free_nodes else None

    @property
    def grids(self) -> Grids | None:
        """The grids of the preconditioner, for models `released` from this one; None where no node is free."""
        return self.work and self.work.preconditioner.grids

    def assemble_true(self, displacement: wp.array) -> tuple[BlockMatrix, Multigrid]:
        """The true Hessian at a displacement from rest, and a preconditioner of it, for a user who is at work.

        The model must have free nodes. `state` is then at that displacement.
        """
        work = self.work
        assert work is not None
        self.state.set_from_rest(displacement)
        work.evaluate()
        work.assemble(true=False, grids=True)
        work.assemble(true=True)
        return work.matrix, work.preconditioner

    def prepare(self) -> None:
        """Assembles the projected Hessian where the last relaxation ended, for the next one with `reuse`."""
        if self.work is not None:
            self.ownership.work(None, self.work.assemble, true=False)

    def relax(
        self,
        tolerance: float | None = None,
        watch: Callable[[RelaxStep, State], None] | None = None,
        *,
        confirm: bool = True,
        confirm_inverted: bool = True,
        near: bool = False,
        reuse: bool = False,
        meanwhile: Callable[[], None] = nothing,
        user: object | None = None,
    ) -> Relaxation:
        """Relaxes `state` until it is known to be nearer to an equilibrium, no saddle, than the tolerance [mm].

        The energy falls at every accepted step, no tetrahedron is inverted that was not inverted at the start
        unless the energy rights inverted ones, and the number of steps is bounded. `watch` is called after each
        accepted step, when its distance is known, with the state, to read and not to change. Without `confirm` it
        ends, NEAR, as soon as the distance before the last step is estimated to be below the tolerance: increments
        on the way need not be known so well. Without `confirm_inverted` an end with inverted tetrahedra is not
        confirmed either: the caller changes the model there. `near` promises that the state is likely some
        tolerances from its end, which saves work where it is so; `reuse`, that it is near the one whose Hessian
        was assembled last (`prepare`). `meanwhile` is called while a device is at work. `user` is the token of a
        user who has taken the relaxer (`ownership`); a relaxation without one takes it.

        Raises:
            InputError: a tolerance that is no positive number, another user at work with this relaxer or since it
                was taken, or a `watch` that moved the tissue.
        """
        check_tolerance(tolerance := self.options.tolerance if tolerance is None else tolerance)
        run = Run(tolerance, confirm, saddle=Saddle(try_true=confirm and near), reuse=Reuse(hessian=reuse))

        def loop(work: Work, history: History) -> Relaxation:
            return self._descend(work, history, run, confirm_inverted, meanwhile)

        return self.evaluate_and(loop, watch, user)

    def evaluate_and(
        self,
        loop: Callable[[Work, History], Relaxation],
        watch: Callable[[RelaxStep, State], None] | None,
        user: object | None,
    ) -> Relaxation:
        """Evaluates the state, and then a loop of any method relaxes it; see `relax`."""

        def evaluated() -> Relaxation:
            start = time.perf_counter()
            (self.work or self.state).evaluate()
            history = History(self.state, start, watch)
            if not math.isfinite(history.energy.total):
                return history.end(RelaxStatus.NOT_FINITE, math.inf)
            if self.work is None:
                return history.end(RelaxStatus.CONVERGED, 0.0)
            return loop(self.work, history)

        return self.ownership.work(user, evaluated)

    def _descend(
        self, work: Work, history: History, run: Run, confirm_inverted: bool, meanwhile: Callable[[], None]
    ) -> Relaxation:
        """The loop of Newton's method; see `relax`."""
        confirm, estimate, leads_on = run.confirm, run.estimate, True
        estimate.floor = self.state.rounding()
        for turn in range(self.options.max_steps + 1):
            # Where it stands: may it end here?
            run.confirm = confirm and (confirm_inverted or not history.inverted_tets)
            if not run.confirm and estimate.solved and estimate.distance <= run.tolerance:
                return history.end(RelaxStatus.NEAR, estimate.distance)
            if not leads_on:
                return history.end(RelaxStatus.STALLED, math.inf)
            if turn == self.options.max_steps:
                break
            # Solve: the direction to the equilibrium, and how far that is.
            action, iterations = find_direction(work, run, meanwhile if turn == 0 else nothing)
            history.solved(estimate.distance, iterations)
            history.evaluations = work.evaluations
            if action is Action.CONVERGED:
                return history.end(RelaxStatus.CONVERGED, estimate.distance)
            if action is Action.STALLED or history.stagnated(estimate.distance):
                return history.end(RelaxStatus.STALLED, math.inf)
            # Line search: a length that lowers the energy and inverts nothing that must not be inverted.
            trial = search(
                work.attempt,
                1.0,
                history.energy.total,
                work.products().slope,
                rounding=history.rounding,
                most=1 if run.reuse.hessian else MOST_TRIALS,  # a Hessian of before is not worth more
            )
            history.evaluations = work.evaluations
            if trial is not None:
                work.accept()
                history.add(trial)
            leads_on = run.after_search(trial and trial.length)
        return history.end(RelaxStatus.STEP_LIMIT, math.inf)


def estimate_distance(work: Work) -> tuple[float, int]:
    """Solves for the Newton step at the state as it is.

    Returns:
        An estimate of how far the equilibrium is [mm], and the linear iterations.
    """
    run = Run(0.0)
    work.evaluate()
    _, iterations = find_direction(work, run)
    return run.estimate.distance, iterations


def find_direction(work: Work, run: Run, meanwhile: Callable[[], None] = nothing) -> tuple[Action, int]:
    """Solves, and solves again or continues the solve, until a direction or the end is found.

    Args:
        work: the state.
        run: the relaxation, which takes note of each solve.
        meanwhile: called while a device is at work with the first solve.

    Returns:
        SEARCH along the direction, CONVERGED or STALLED; and the linear iterations.
    """
    spent, saddle = 0, run.saddle
    while True:
        planned = run.plan()
        solution = work.solve(planned, meanwhile)
        meanwhile = nothing
        spent += solution.iterations
        if planned.true and saddle.down is not None:
            if work.curvature(saddle.down) < 0.0:
                solution = replace(solution, outcome=Outcome.NEGATIVE_CURVATURE)
            else:
                saddle.down = None  # the state has left it
        action, claimed = run.after_solve(planned, solution), False
        if action is Action.TRY:
            action = judge_trial(work.products().slope, work.attempt(1.0).products.slope)
        if action is Action.CERTIFY:
            claimed = True
            action, iterations = work.certificate.claim(run, solution, work.state.rounding())
            spent += iterations
        match action:
            case Action.SOLVE:
                continue
            case Action.DESCEND:
                saddle.down = work.negative_curvature() if saddle.down is None else saddle.down
                work.descend(saddle.down, run.tolerance, on=not claimed)
                return Action.SEARCH, spent
            case Action.SEARCH | Action.CONVERGED | Action.STALLED:
                if claimed and action is Action.SEARCH:
                    work.turn_downhill()  # noise may point either way
                return action, spent
            case Action.TRY | Action.CERTIFY:
                raise AssertionError
