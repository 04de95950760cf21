"""Where a relaxation goes next: pure Python, from how the last linear solve ended and what is known of the way.

Far away the Hessian is projected to a positive semidefinite one, so that every direction descends; it is stiffer
than the truth, and its steps are shorter than the way to go. Where the end is to be confirmed, the true one takes
over near it. If that is negative along some direction, the projected one leads nearer, or from a saddle the step
descends along that direction (Steihaug 1983). At the end the last solve is continued with noise until no saddle
can have been missed (`certify`)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from .certify import Step, reach
from .linear import LinearSolution, Outcome


class Phase(Enum):
    """The origin of the last direction."""

    PROJECTED = "a solve with the Hessian projected to a positive semidefinite one"
    TRUE = "a solve with the true Hessian"
    SADDLE = "a direction that noise has shown, or of negative curvature of the true Hessian"


class Action(Enum):
    """The next thing after a linear solve."""

    SEARCH = "search along its solution"
    DESCEND = "search along its direction of negative curvature"
    SOLVE = "solve again, as planned now"
    TRY = "try the whole step, by which a claim would be made"
    CERTIFY = "continue it with noise until no saddle can have been missed"
    CONVERGED = "end: the equilibrium is nearer than the tolerance, and no saddle"
    STALLED = "end: nothing can be claimed, and nothing leads on"


@dataclass(frozen=True)
class Policy:
    """The constants of the decisions, each with its evidence."""

    accuracy: float = 0.1
    """The part of the tolerance that a solve may leave."""
    projected_accuracy: float = 0.3
    """The part of the distance that a solve with the projected Hessian may leave. Such a step leaves more where
    tissue is crushed: solves to a tenth took as many steps, and a third more iterations. Where volume is a
    thousand times as stiff as usual they took a fifth of the iterations."""
    true_accuracy: float = 0.03
    """The same of the true one, whose steps leave less. With 0.1 the papers' method takes 7 to 9 % fewer
    iterations, with 0.3 12 to 14 %, and a claim on a column next to buckling is false with either."""
    first: float = 2.0 / 3.0
    """The part of the distance that the first step of a relaxation is assumed to leave: its Hessian, projected, is
    too stiff where edges are compressed, and no step has been seen yet."""
    reusable: float = 0.5
    """The part of its length that a step with a Hessian of before may leave before the next takes that of the
    state, which costs as much as two such steps. Where a tetrahedron was crushed meanwhile, steps with the former
    were centimetres long."""
    slowest: float = 0.9
    """Steps are assumed to shrink at least this fast from one to the next, also where none as long was seen."""
    near: float = 0.3
    """The true Hessian takes over within so many mm, or the tolerance: beyond, crushed tissue has negative
    curvature."""
    nearer: float = 0.25
    """The part of the distance to which the projected Hessian leads before the true one, found indefinite, is
    tried again."""
    least_noise: float = 1e-5
    """Standard deviation of the noise on a gradient of zero, in roundings."""
    chance: float = 1e-3
    """Of a claim that is false because a saddle was missed. Ten times less takes 35 iterations more."""
    deviations: float = 3.0
    """Standard deviations of noise, and of rounding of forces, for which a distance allows."""
    rounding_of_forces: float = 1e-2
    """Standard deviation of the rounding of forces: that part of the rounding error of distances, by the mean
    stiffness of a node. Without it 2 of 387 claims in float32 on columns next to buckling were false."""
    rounding: float = 1.0
    """Roundings of the largest eigenvalue by which an eigenvalue may be wrong. With ten of them float32 claimed 43
    of 60 columns next to buckling, with one 50; no claim was false."""
    slope: float = 0.25
    """The part of its slope that the step to the end may leave, as in the theorem of Newton and Kantorovich. Where
    stiff motions set its length, the Hessian of a soft one can change on the way unseen: a step of 0.02 mm left
    0.56, and the next was 3.5 mm long; one left 0.48, with 0.28 mm to go."""
    negligible: float = 1e-3
    """The part of the tolerance up to which a step, as one of rounding, is neither tried nor taken where all else
    allows a claim: its slopes are rounding, and no part of it lowers the energy."""
    stretch: int = 32
    """The most iterations by which a solve with noise is continued before the chance is computed again."""


POLICY = Policy()


@dataclass(frozen=True)
class PlannedSolve:
    """The next linear solve."""

    true: bool
    """Whether with the true Hessian."""
    fresh: bool
    """Whether with the Hessian of the state itself, or else the last of its kind."""
    grids: bool
    """Whether the grids of the preconditioner follow the Hessian."""
    absolute: float
    """The error of any vector that it may leave [mm]."""
    relative: float
    """The same as a part of the longest."""
    least_iterations: int
    """Iterations before it may end."""
    short: bool
    """Whether few are expected, so that convergence is tested sooner."""


@dataclass
class Run:
    """Everything that changes during one relaxation, beside its state and the steps it reports."""

    tolerance: float
    """Wanted distance [mm]."""
    confirm: bool = False
    """Whether the end is to be confirmed."""
    try_true: bool = False
    """Whether the next solve is with the true Hessian, however far the end is."""
    reuse: bool = False
    """Whether solves may still take the projected Hessian that was assembled before the relaxation."""
    floor: float = 0.0
    """Rounding error of every distance [mm]."""
    phase: Phase = Phase.PROJECTED
    """The origin of the last direction."""
    distance: float = math.inf
    """How far the equilibrium is estimated to be from where the last solve was [mm]; infinite where not known."""
    known: bool = False
    """Whether the solve behind the distance ended SOLVED."""
    length: float = math.inf
    """Of the longest vector of the last solution [mm]."""
    norm: float = 0.0
    """The square root of g . M^-1 g where that was found."""
    left: float = 0.0
    """The part of the last true step that it left, by how much less the gradient fell [mm]."""
    whole: bool = False
    """Whether the last solution was taken as a whole step."""
    cut: bool = False
    """Whether the line search had to cut a step, or noise showed what a solve had not reached. Then stiff motions
    hide soft ones, and a short solve of what a step along the soft ones left would look converged: solves no
    longer end early."""
    longest_solve: int = 0
    """The most iterations of a solve for a step, or of one with noise that led to a step."""
    nearer: float = math.inf
    """The distance within which the true Hessian, found indefinite, is tried again [mm]."""
    at_saddle: bool = False
    """Whether negative curvature is followed rather than avoided."""
    down: np.ndarray | None = None
    """The last direction of negative curvature, shape (free nodes, 3), until the state has left it."""
    steps: list[Step] = field(default_factory=list)
    """Whole steps along the true Hessian."""


def plan(run: Run, policy: Policy = POLICY) -> PlannedSolve:
    """The next linear solve."""
    within = min(run.nearer, max(run.tolerance, policy.near))
    was_true = run.phase is Phase.TRUE
    true = run.confirm and (run.try_true or (was_true and run.whole) or run.distance <= within)
    return PlannedSolve(
        true,
        fresh=true or not run.reuse,
        grids=run.confirm and not true and math.isinf(run.length),
        absolute=policy.accuracy * run.tolerance,
        relative=policy.true_accuracy if true else policy.projected_accuracy,
        least_iterations=run.longest_solve if run.cut else 0,
        short=run.reuse,
    )


def decide(run: Run, planned: PlannedSolve, solution: LinearSolution, policy: Policy = POLICY) -> Action:
    """The next thing after a planned solve."""
    run.try_true = False
    if solution.outcome is Outcome.SOLVED:
        run.longest_solve = max(run.longest_solve, solution.iterations)
    match solution.outcome:
        case _ if not planned.fresh and _leads_astray(run, solution, policy):
            run.reuse = False
            return Action.SOLVE
        case Outcome.UNSOUND if not planned.true:
            return Action.STALLED
        case Outcome.UNSOUND:  # the preconditioner was made too far away
            return _avoid(run, policy)
        case Outcome.NEGATIVE_CURVATURE if planned.true:
            return _descend(run) if run.at_saddle else _avoid(run, policy)
        case Outcome.SOLVED | Outcome.EXHAUSTED | Outcome.NEGATIVE_CURVATURE:  # of a projected one: rounding
            _estimate(run, planned, solution, policy)
            near = run.known and max(run.distance, bound(run, policy)) <= run.tolerance
            negligible = run.length <= max(run.floor, policy.negligible * run.tolerance)
            if near and planned.true:
                return Action.CERTIFY if negligible else Action.TRY
            if near and negligible and plan(run, policy).true:
                run.whole = False
                return Action.SOLVE
            # no force is left, but rounding alone may be farther than the tolerance
            return Action.SEARCH if run.length > 0.0 or run.distance <= run.tolerance else Action.STALLED
    raise AssertionError(solution.outcome)


def decide_end(
    run: Run, solution: LinearSolution, chance: float, hidden: float, policy: Policy = POLICY
) -> Action:
    """The next thing after a solve with noise that is continued.

    Args:
        run: the relaxation.
        solution: of the solve.
        chance: that it missed a saddle.
        hidden: how far the noise may have moved the solution [mm].
        policy: the constants.
    """
    match solution.outcome:
        case Outcome.NEGATIVE_CURVATURE:
            return _descend(run)
        case Outcome.EXHAUSTED | Outcome.UNSOUND:  # soft directions hide behind others 1e6 times as stiff
            return Action.STALLED
        case Outcome.SOLVED if math.isinf(chance):
            return Action.STALLED
        case Outcome.SOLVED:
            # noise may cancel a part of it
            run.length = max(run.length, solution.length + solution.error, hidden)
            run.distance = max(bound(run, policy), policy.accuracy * run.tolerance)
            if run.distance > run.tolerance:
                # neither the solves before reached this direction nor do their steps say anything of it
                run.phase, run.cut = Phase.SADDLE, True
                run.longest_solve = max(run.longest_solve, solution.iterations)
                return Action.SEARCH
            return Action.CONVERGED if chance <= policy.chance else Action.CERTIFY
    raise AssertionError(solution.outcome)


def decide_claim(before: float, after: float, policy: Policy = POLICY) -> Action:
    """CERTIFY or SEARCH where all else allows a claim, by a trial of the whole step that it is made of.

    The energy itself says less: near zero it is the sum of parts whose rounding is larger than its change.

    Args:
        before: slope of the energy along the step at its start, negative.
        after: slope at its end, positive where the step overshoots.
    """
    return Action.SEARCH if abs(after) > policy.slope * abs(before) else Action.CERTIFY


def stretch(iterations: int, first: float, chance: float, policy: Policy = POLICY) -> int:
    """Iterations by which a solve is continued: what is expected, by the chance after the first and after all."""
    fallen, missing = math.log(first / chance), math.log(chance / policy.chance)
    return int(min(policy.stretch, iterations * missing / max(fallen, 1e-3))) + 1


def bound(run: Run, policy: Policy = POLICY) -> float:
    """The distance within which there is an equilibrium, by the true steps so far [mm]."""
    return run.floor + reach(max(run.length, run.left), run.steps, policy.slowest)


def _leads_astray(run: Run, solution: LinearSolution, policy: Policy) -> bool:
    """Whether a Hessian of before is too far from that of the state, by what its last step left."""
    return solution.outcome is not Outcome.SOLVED or solution.length > policy.reusable * run.length


def _avoid(run: Run, policy: Policy) -> Action:
    """The true Hessian was tried too far away: the projected one leads nearer."""
    run.nearer = min(run.nearer, policy.nearer * run.distance)
    run.at_saddle = run.nearer <= run.tolerance
    run.phase, run.distance = Phase.PROJECTED, math.inf
    return Action.SOLVE


def _descend(run: Run) -> Action:
    """Negative curvature of the true Hessian near the end is followed downwards."""
    run.phase, run.distance, run.at_saddle = Phase.SADDLE, math.inf, True
    return Action.DESCEND


def _estimate(run: Run, planned: PlannedSolve, solution: LinearSolution, policy: Policy) -> None:
    """Sets the distance by the length of a solution and how much shorter it is than the one before."""
    length, before = solution.length + solution.error, run.length
    run.known = solution.outcome is Outcome.SOLVED
    run.left = 0.0
    if planned.true and run.whole and run.phase is Phase.TRUE:
        run.left = solution.norm / run.norm * before
        run.steps.append(Step(before, max(run.left, length)))
    left = policy.first
    if 0.0 < before < math.inf:
        fallen = solution.norm / run.norm  # less than the length, where stiff motions hide soft ones
        left = min(max(length / before, fallen), policy.slowest)
        run.known = run.known and (run.confirm or fallen <= 1.0)  # or else the step strained stiff motions
    run.length, run.norm = length, solution.norm
    run.phase = Phase.TRUE if planned.true else Phase.PROJECTED
    run.distance = run.floor + length * max(1.0, left / (1.0 - left))


def searched(run: Run, length: float | None) -> bool:
    """Takes note of the part of the direction that was taken; None where none lowers the energy.

    Returns:
        Whether the relaxation can go on.
    """
    run.whole = length == 1.0
    if length is None and run.reuse:  # with the Hessian of the state one may
        run.reuse, run.known, run.length = False, False, math.inf
        return True
    if length is None:  # the true Hessian is tried once where the projected one leads nowhere
        run.try_true = run.at_saddle = True
        return run.confirm and run.phase is Phase.PROJECTED
    if run.phase is Phase.SADDLE:
        run.length = math.inf
        run.steps.clear()
    else:
        run.cut = run.cut or length < 1.0
    return True
