"""Where a relaxation goes next: pure Python, from how the last linear solve ended and what is known of the way.

Far away the Hessian is projected to a positive semidefinite one, so that every direction descends; it is stiffer
than the truth, and its steps are shorter than the way to go. Where the end is to be confirmed, the true one takes
over near it. If that is negative along some direction, the projected one leads nearer, or from a saddle the step
descends along that direction (Steihaug 1983). At the end the last solve is continued with noise until no saddle
can have been missed (`certify`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from .outcome import LinearSolution, Outcome


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
    accuracy_on_the_way: float = 0.5
    """The same part in increments that need no claim, but with a Hessian of before: steps with that are given up
    where they leave as much. With 0.3 the default took 270 linear iterations for 224."""
    true_accuracy: float = 0.03
    """The same part of the true one, whose steps leave less. With 0.1 the papers' method takes 7 to 9 % fewer
    iterations, with 0.3 12 to 14 %, and a claim on a column next to buckling is false with either."""
    first: float = 2.0 / 3.0
    """The part of the distance that the first step of a relaxation is assumed to leave: its Hessian, projected, is
    too stiff where edges are compressed, and no step has been seen yet."""
    reusable: float = 0.5
    """The part of its length that a step with a Hessian of before may leave before the next takes that of the
    state, which costs as much as two such steps. Where a tetrahedron was crushed meanwhile, steps with the former
    were centimetres long."""
    slowest: float = 0.9
    """The part of a step that the next is assumed to have at most, also where none as long was seen."""
    near: float = 0.3
    """The true Hessian takes over within this distance [mm], or the tolerance: beyond, crushed tissue has negative
    curvature."""
    nearer: float = 0.25
    """The part of the distance to which the projected Hessian leads before the true one, found indefinite, is
    tried again."""
    least_noise: float = 1e-5
    """Standard deviation of the noise on a gradient of zero, in roundings."""
    chance: float = 1e-3
    """The chance that a claim is false because a saddle was missed. Ten times less takes 35 iterations more."""
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


@dataclass(frozen=True)
class Step:
    """A whole step along the true Hessian."""

    length: float
    """Of its longest vector [mm]."""
    remainder: float
    """The part of that which it left: by the solve after it, or by how much less the gradient fell [mm]."""


@dataclass
class Estimate:
    """The distance to the equilibrium, as a relaxation has found it so far."""

    floor: float = 0.0
    """Rounding error of every distance [mm]."""
    phase: Phase = Phase.PROJECTED
    """The origin of the last direction."""
    distance: float = math.inf
    """How far the equilibrium is estimated to be from where the last solve was [mm]; infinite where not known."""
    solved: bool = False
    """Whether the solve behind the distance ended SOLVED."""
    length: float = math.inf
    """Of the longest vector of the last solution [mm]."""
    gradient_norm: float = 0.0
    """The square root of g . M^-1 g where that was found [root of the energy's unit]."""
    remainder: float = 0.0
    """The part of the last true step that it left, by how much less the gradient fell [mm]."""
    whole: bool = False
    """Whether the last solution was taken as a whole step."""
    cut: bool = False
    """Whether the line search had to cut a step, or noise showed what a solve had not reached. Then stiff motions
    hide soft ones, and a short solve of what a step along the soft ones left would look converged: solves no
    longer end early."""
    longest_solve: int = 0
    """The most iterations of a solve for a step, or of one with noise that led to a step."""
    steps: list[Step] = field(default_factory=list)
    """Whole steps along the true Hessian."""

    def update(self, solution: LinearSolution, *, true: bool, confirm: bool) -> None:
        """Sets the distance by the length of a solution and how much shorter it is than the one before."""
        length, before = solution.length + solution.error, self.length
        self.solved, self.remainder = solution.outcome is Outcome.SOLVED, 0.0
        if true and self.whole and self.phase is Phase.TRUE:
            self.remainder = solution.gradient_norm / self.gradient_norm * before
            self.steps.append(Step(before, max(self.remainder, length)))
        contraction = POLICY.first
        if 0.0 < before < math.inf:
            fallen = solution.gradient_norm / self.gradient_norm  # less than the length, where stiff hides soft
            contraction = min(max(length / before, fallen), POLICY.slowest)
            self.solved = self.solved and (confirm or fallen <= 1.0)  # or else the step strained stiff motions
        self.length, self.gradient_norm = length, solution.gradient_norm
        self.phase = Phase.TRUE if true else Phase.PROJECTED
        self.distance = self.floor + length * max(1.0, contraction / (1.0 - contraction))

    def bound(self) -> float:
        """The distance within which there is an equilibrium, by the true steps so far [mm]."""
        return self.floor + reach(max(self.length, self.remainder), self.steps, POLICY.slowest)


@dataclass
class Saddle:
    """The saddles that a relaxation has met."""

    try_true: bool = False
    """Whether the next solve is with the true Hessian, however far the end is."""
    nearer: float = math.inf
    """The distance within which the true Hessian, found indefinite, is tried again [mm]."""
    is_near: bool = False
    """Whether negative curvature is followed rather than avoided."""
    down: np.ndarray | None = None
    """The last direction of negative curvature, shape (free nodes, 3), until the state has left it."""


@dataclass
class Reuse:
    """The parts of the solver that a relaxation may take from before."""

    hessian: bool = False
    """Whether solves may still take the projected Hessian that was assembled before the relaxation."""
    grids: bool = False
    """Whether the preconditioner's grids need not follow the next projected Hessian: they have followed one, and
    the relaxation has not gone another way since."""


@dataclass
class Run:
    """Everything that changes during one relaxation, beside its state and the steps it reports.

    `plan` looks at it; each method called `after_` takes note of what was done and says what comes next."""

    tolerance: float
    """Wanted distance [mm]."""
    confirm: bool = False
    """Whether the end is to be confirmed."""
    estimate: Estimate = field(default_factory=Estimate)
    """The distance, as estimated."""
    saddle: Saddle = field(default_factory=Saddle)
    """The saddles that were met."""
    reuse: Reuse = field(default_factory=Reuse)
    """The parts that may be reused."""

    def plan(self) -> PlannedSolve:
        """The next linear solve."""
        estimate, saddle = self.estimate, self.saddle
        within = min(saddle.nearer, max(self.tolerance, POLICY.near))
        went_true = estimate.phase is Phase.TRUE and estimate.whole
        true = self.confirm and (saddle.try_true or went_true or estimate.distance <= within)
        on_the_way = not self.confirm and not self.reuse.hessian
        projected = POLICY.accuracy_on_the_way if on_the_way else POLICY.projected_accuracy
        return PlannedSolve(
            true,
            fresh=true or not self.reuse.hessian,
            grids=self.confirm and not true and not self.reuse.grids,
            absolute=POLICY.accuracy * self.tolerance,
            relative=POLICY.true_accuracy if true else projected,
            least_iterations=estimate.longest_solve if estimate.cut else 0,
        )

    def after_solve(self, planned: PlannedSolve, solution: LinearSolution) -> Action:
        """The next thing after a planned solve."""
        estimate, self.saddle.try_true = self.estimate, False
        if solution.outcome is Outcome.SOLVED:
            estimate.longest_solve = max(estimate.longest_solve, solution.iterations)
        if not planned.fresh and self._led_astray(solution):
            self.reuse.hessian = False
            return Action.SOLVE
        match solution.outcome:
            case Outcome.UNSOUND if not planned.true:
                return Action.STALLED
            case Outcome.UNSOUND:  # the preconditioner was made too far away
                return self._avoid()
            case Outcome.NEGATIVE_CURVATURE if planned.true:
                return self._descend() if self.saddle.is_near else self._avoid()
            case Outcome.SOLVED | Outcome.EXHAUSTED | Outcome.NEGATIVE_CURVATURE:  # of a projected one: rounding
                estimate.update(solution, true=planned.true, confirm=self.confirm)
                self.reuse.grids = True
                near = estimate.solved and max(estimate.distance, estimate.bound()) <= self.tolerance
                negligible = estimate.length <= max(estimate.floor, POLICY.negligible * self.tolerance)
                if near and planned.true:
                    return Action.CERTIFY if negligible else Action.TRY
                if near and negligible and self.plan().true:
                    estimate.whole = False
                    return Action.SOLVE
                if estimate.length == 0.0 and estimate.distance > self.tolerance:  # no force, but rounding
                    return Action.STALLED
                return Action.SEARCH

    def after_noise(self, solution: LinearSolution, chance: float, hidden: float) -> Action:
        """The next thing after a solve with noise that is continued.

        Args:
            solution: of the solve.
            chance: that it missed a saddle.
            hidden: how far the noise may have moved the solution [mm].
        """
        estimate = self.estimate
        match solution.outcome:
            case Outcome.NEGATIVE_CURVATURE:
                return self._descend()
            case Outcome.EXHAUSTED | Outcome.UNSOUND:  # soft directions hide behind others 1e6 times as stiff
                return Action.STALLED
            case Outcome.SOLVED if math.isinf(chance):
                return Action.STALLED
            case Outcome.SOLVED:
                # noise may cancel a part of it
                estimate.length = max(estimate.length, solution.length + solution.error, hidden)
                estimate.distance = max(estimate.bound(), POLICY.accuracy * self.tolerance)
                if estimate.distance > self.tolerance:
                    # neither the solves before reached this direction nor do their steps say anything of it
                    estimate.phase, estimate.cut = Phase.SADDLE, True
                    estimate.longest_solve = max(estimate.longest_solve, solution.iterations)
                    return Action.SEARCH
                return Action.CONVERGED if chance <= POLICY.chance else Action.CERTIFY

    def after_search(self, length: float | None) -> bool:
        """Whether the relaxation can go on after a part of the direction was taken, None where none helped."""
        estimate = self.estimate
        estimate.whole = length == 1.0
        if length is None and self.reuse.hessian:  # with the Hessian of the state one may
            self.reuse = Reuse()
            estimate.solved, estimate.length = False, math.inf
            return True
        if length is None:  # the true Hessian is tried once where the projected one leads nowhere
            self.saddle.try_true = self.saddle.is_near = True
            return self.confirm and estimate.phase is Phase.PROJECTED
        if estimate.phase is Phase.SADDLE:
            estimate.length, self.reuse.grids = math.inf, False
            estimate.steps.clear()
        else:
            estimate.cut = estimate.cut or length < 1.0
        return True

    def _led_astray(self, solution: LinearSolution) -> bool:
        """Whether a Hessian of before is too far from that of the state, by what its last step left."""
        solved = solution.outcome is Outcome.SOLVED
        return not solved or solution.length > POLICY.reusable * self.estimate.length

    def _avoid(self) -> Action:
        """The true Hessian was tried too far away: the projected one leads nearer."""
        self.saddle.nearer = min(self.saddle.nearer, POLICY.nearer * self.estimate.distance)
        self.saddle.is_near = self.saddle.nearer <= self.tolerance
        self.estimate.phase, self.estimate.distance = Phase.PROJECTED, math.inf
        return Action.SOLVE

    def _descend(self) -> Action:
        """Negative curvature of the true Hessian near the end is followed downwards."""
        self.estimate.phase, self.estimate.distance, self.saddle.is_near = Phase.SADDLE, math.inf, True
        return Action.DESCEND


def judge_trial(before: float, after: float) -> Action:
    """CERTIFY or SEARCH where all else allows a claim, by a trial of the whole step that it is made of.

    The energy itself says less: near zero it is the sum of parts whose rounding is larger than its change.

    Args:
        before: slope of the energy along the step at its start, negative.
        after: slope at its end, positive where the step overshoots.
    """
    return Action.SEARCH if abs(after) > POLICY.slope * abs(before) else Action.CERTIFY


def stretch(iterations: int, first: float, chance: float) -> int:
    """Iterations by which a solve is continued: what is expected, by the chance after the first and after all."""
    fallen, missing = math.log(first / chance), math.log(chance / POLICY.chance)
    return int(min(POLICY.stretch, iterations * missing / max(fallen, 1e-3))) + 1


def reach(remainder: float, steps: Sequence[Step], slowest: float) -> float:
    """How far the equilibrium can be where a Newton step has a length [mm].

    The last step at least as long shows how little the Hessian changes on the way: if it left a part q of itself,
    there is one equilibrium within 1 / (1 - q) of the length (Newton and Kantorovich). q is at most `slowest`,
    also where there was none.
    """
    seen = (step.remainder / step.length for step in reversed(steps) if step.length >= remainder > 0.0)
    return remainder / (1.0 - min(next(seen, slowest), slowest))
