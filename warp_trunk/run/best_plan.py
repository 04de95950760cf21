"""The plan within a surgeon's bounds that flattens the back most, by derivatives of whole simulations."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from warp_trunk.bone_motion.plan import Plan, Planner
from warp_trunk.bone_motion.plan.record import Bound, bounded_shares, bounds_of_text, check_bounds, with_shares
from warp_trunk.case import Case
from warp_trunk.checking import checked
from warp_trunk.engine.linearization import Linearization
from warp_trunk.errors import InputError
from warp_trunk.measures.levels import JUDGED, largest_at
from warp_trunk.measures.quantities import QUANTITIES, WIDTH

from .options import Execution, RunOptions
from .patient import PreparedPatient, patient_of
from .prediction import prepare_plan
from .progress import Progress, Silent
from .sensitivities import Sensitivity, sensitivities
from .sources import effect_of, sources_of

Aim = Literal["hump", "bsr"]
AIMS = {"hump": ("hump_mm", "hump", "mm"), "bsr": ("bsr_deg", "back surface rotation", "degrees")}
"""The quantity of each whose largest value is to be small, and it in words with its unit."""
MOST_RELAXATIONS = 9
"""Relaxations of a search, that of the plan as given included."""
LEAST_GAIN = 2e-4
"""Part of the aim by which a step must be expected to lower it."""
SHARE_STEP = 1e-3
"""Change of a share to either side for what it does to landmarks, a closed formula to 1e-5 of it."""


class PlanTrial:
    """A plan that was simulated."""

    shares: tuple[float, ...]
    """Its value for each bound."""
    values: dict[str, float]
    """The numbers that the aim is the largest of, by level [mm or degrees]."""

    def __init__(self, search: Search, patient: PreparedPatient, shares: tuple[float, ...]) -> None:
        self.shares, self._search = shares, search
        self.case = search.planned(shares)
        self.prediction = prepare_plan(patient, self.case).relax()
        measured = self.prediction.measures_at(self.prediction.last)
        by_level = QUANTITIES[AIMS[search.aim][0]].function(measured, measured)
        self.values = {level: value for level in JUDGED if (value := by_level.get(level)) is not None}

    @property
    def level(self) -> str:
        """Where the number of largest size is."""
        return largest_at(self.values) or ""

    @property
    def value(self) -> float:
        """The objective: the size of that number [mm or degrees]."""
        return self.size_at(self.level)

    def size_at(self, level: str) -> float:
        """The size of the number of a level [mm or degrees]; 0 where there is none."""
        return abs(self.values.get(level, 0.0))

    @cached_property
    def numbers(self) -> dict[str, Sensitivity]:
        """The number of each level with what it depends on."""
        aim, prediction = self._search.aim, self.prediction
        linear = Linearization(prediction.model, prediction.last, relaxer=prediction.relaxer)
        all_numbers = sensitivities(prediction, all_humps=aim == "hump", linear=linear)
        return {number.level: number for number in all_numbers if number.quantity == AIMS[aim][0]}

    def slopes(self) -> dict[str, np.ndarray]:
        """The derivative of each number in each bounded share, shape (bounds,)."""
        moves = self._search.landmark_moves(self.shares)
        return {
            level: np.array([np.vdot(number.landmarks_after, move) for move in moves])
            for level, number in self.numbers.items()
        }


@dataclass(frozen=True, eq=False)
class Search:
    """The search."""

    case: Case
    """The patient; what is planned in it is not read."""
    plan: Plan
    """The plan as given."""
    aim: Aim
    """Largest hump [mm], or largest back surface rotation [degrees], of any level and to either side."""
    bounds: tuple[Bound, ...]
    """Within what the plan may be changed."""

    def planned(self, shares: Sequence[float]) -> Case:
        """The case after the plan with other shares."""
        return self._planner.plan(with_shares(self.plan, self.bounds, shares)).planned_case(self.case)

    @cached_property
    def _planner(self) -> Planner:
        return Planner(self.case)

    def landmark_moves(self, shares: Sequence[float]) -> list[np.ndarray]:
        """How landmarks after surgery move with each share [mm], shape (landmarks, 3) each."""
        moves = []
        for place, share in enumerate(shares):
            ends = min(share + SHARE_STEP, 1.0), max(share - SHARE_STEP, 0.0)
            upper, lower = (
                self.planned([*shares[:place], end, *shares[place + 1 :]]).planned_landmarks.points for end in ends
            )
            moves.append((upper - lower) / (ends[0] - ends[1]))
        return moves

    def check(self) -> None:
        """Raise InputError for bounds that do not fit the plan, or at whose ends no spine can be placed."""
        check_bounds(self.plan, self.bounds)
        for shares in product(*((bound.low, bound.high) for bound in self.bounds)):
            try:
                self.planned(shares)
            except InputError as error:
                ends = zip(self.bounds, shares, strict=True)
                at = ", ".join(f"{bound.target} {share:g} of {bound.apex}" for bound, share in ends)
                raise InputError(f"--within: at {at}: {str(error).removeprefix('plan: ')}") from None


@dataclass(frozen=True, eq=False)
class BestPlan:
    """The best plan that was found, beside the one that was given."""

    search: Search
    """The search."""
    plan: Plan
    """The best plan."""
    start: PlanTrial
    """The plan as given, simulated."""
    best: PlanTrial
    """The best one, simulated; the same where none within the bounds is better."""
    trials: tuple[PlanTrial, ...]
    """All that were simulated, in order."""
    gain: float
    """By how much the aim is smaller where the plan as given has its largest [mm or degrees]."""
    gain_sd: float
    """The standard deviation of that, from the sources that the case states."""


@checked
def best_plan(
    case: Case | PreparedPatient,
    plan: Plan,
    within: Sequence[str | Bound],
    aim: Aim = "hump",
    options: RunOptions | None = None,
    execution: Execution | None = None,
    *,
    progress: Progress | None = None,
    most: Annotated[int, Meta(ge=1, le=1000)] = MOST_RELAXATIONS,
) -> BestPlan:
    """Find the plan within bounds whose largest hump or back surface rotation is smallest.

    >>> plan = wt.Plan(uiv="T4", liv="L1", curves=[wt.CurvePlan("T8", correction=0.5)])
    >>> best = wt.best_plan(case, plan, ["T8,correction=0.4..0.6"], options=small, most=2)
    >>> best.best.value <= best.start.value
    True

    The largest of many numbers is minimised by sequential quadratic programming (Kraft 1988, SciPy's SLSQP): least
    t with t at least as large as every number to either side. Each plan that is tried costs one relaxation, and
    its derivatives one linear solve for each level, all at once.

    Args:
        case: the patient, or the patient made ready by `patient_of`, with her options; what is planned in the
            case is not read.
        plan: the plan from which the search starts.
        within: what may change and between which shares, for each curve: `T8,correction=0.5..0.8`, or a `Bound`.
        aim: what to make small: the largest hump [mm], or the largest back surface rotation [degrees].
        options: what is simulated; the defaults when left out.
        execution: how it is computed; the defaults when left out.
        progress: where to show each plan; nothing is shown when left out.
        most: the number of relaxations, at most.

    Raises:
        InputError: bounds that do not fit the plan, a plan that cannot be met, or a relaxation that does not
            converge.
    """
    patient = case if isinstance(case, PreparedPatient) else None
    case = case.case if isinstance(case, PreparedPatient) else case
    if patient is not None and (options, execution) != (None, None):
        raise InputError("best_plan: a patient made ready has her options; leave 'options' and 'execution' out")
    progress = progress or Silent()
    bounds = [(entry,) if isinstance(entry, Bound) else bounds_of_text(entry) for entry in within]
    search = Search(case, plan, aim, tuple(bound for some in bounds for bound in some))
    search.check()
    if patient is None:
        patient = patient_of(case, options, execution=execution, progress=progress)
        search = replace(search, case=patient.case)
    trials: list[PlanTrial] = []

    def trial_at(shares: Sequence[float]) -> PlanTrial:
        for trial in trials:
            if np.allclose(trial.shares, shares, rtol=0.0, atol=1e-9):
                return trial
        if len(trials) >= most:
            raise _SpentError
        with progress.stage("search", f"simulating plan {len(trials) + 1}"):
            trial = PlanTrial(search, patient, tuple(map(float, shares)))
        trials.append(trial)
        listed = ", ".join(f"{share:.2f}" for share in trial.shares)
        result = f"{trial.value:.2f} {AIMS[aim][2]} at {trial.level}"
        progress.message(f"plan {len(trials)}: {listed}: {result}")
        return trial

    start = trial_at(bounded_shares(plan, search.bounds))
    with suppress(_SpentError):
        _minimise(search.bounds, start, trial_at)
    low, high = np.array([(bound.low, bound.high) for bound in search.bounds]).T
    allowed = [trial for trial in trials if np.all((low <= trial.shares) & (trial.shares <= high))]
    best = min([start, *allowed], key=lambda trial: trial.value)
    sd = 0.0 if best is start else gain_sd(search, start, best)
    best_one = with_shares(plan, search.bounds, best.shares)
    gain = start.value - best.size_at(start.level)
    return BestPlan(search, best_one, start, best, tuple(trials), gain, sd)


class _SpentError(Exception):
    """As many relaxations were made as may be."""


def _minimise(bounds: Sequence[Bound], first: PlanTrial, trial_of: Callable[[Sequence[float]], PlanTrial]) -> None:
    """Try plans until the largest number no longer falls."""
    from scipy.optimize import minimize

    low = np.array([bound.low for bound in bounds])
    width = np.array([bound.high for bound in bounds]) - low
    levels, size = list(first.values), max(first.value, 1e-6)

    def trial_at(z: np.ndarray) -> PlanTrial:
        return trial_of(np.clip(low + width * z[:-1], low, low + width).tolist())

    def slack(z: np.ndarray) -> np.ndarray:
        values_there = trial_at(z).values
        values = np.array([values_there.get(level, 0.0) for level in levels]) / size
        return np.concatenate([z[-1] - values, z[-1] + values])

    def slack_slopes(z: np.ndarray) -> np.ndarray:
        slopes = trial_at(z).slopes()
        still = np.zeros(len(width))
        rows = np.array([slopes.get(level, still) for level in levels]) * width / size
        return np.column_stack([np.concatenate([-rows, rows]), np.ones(2 * len(levels))])

    start = np.clip((np.array(first.shares) - low) / width, 0.0, 1.0)
    value = trial_at(np.append(start, 1.0)).value
    upward = np.append(np.zeros(len(width)), 1.0)
    minimize(
        lambda z: z[-1],
        np.append(start, value / size),
        jac=lambda _: upward,
        bounds=[*((0.0, 1.0) for _ in width), (0.0, None)],
        constraints={"type": "ineq", "fun": slack, "jac": slack_slopes},
        method="SLSQP",
        options={"ftol": LEAST_GAIN},
    )


def gain_sd(search: Search, start: PlanTrial, best: PlanTrial) -> float:
    """Standard deviation of how much smaller the aim is of one plan than of the other, where the former has its
    largest.

    Errors of the patient (landmarks, tissue, ribs) are the same for both plans, so only their effect on the
    difference counts. How surgery misses a plan is not the same; it adds up.
    """
    case = search.case
    moved = np.zeros_like(case.landmarks_before.points)
    shared: dict[str, float] = defaultdict(float)
    missed = 0.0
    for trial, side in ((start, 1.0), (best, -1.0)):
        number = trial.numbers[start.level]
        sign = side * math.copysign(1.0, number.value)
        moved = moved + sign * (number.landmarks_before + number.landmarks_after)
        for source in sources_of(trial.prediction):
            effect = sign * effect_of(source, number)
            if source.of_surgery:
                missed += effect**2
            else:
                shared[source.name] += effect
    mesh = case.uncertainty.mesh_length if search.aim == "hump" else case.uncertainty.mesh_rotation
    landmarks = case.uncertainty.landmark_sd * float(np.linalg.norm(moved))
    return math.sqrt(missed + sum(effect**2 for effect in shared.values()) + landmarks**2 + mesh**2)


def best_plan_text(outcome: BestPlan) -> str:
    """The shares that changed, what is gained against the plan as given, and how sure that is."""
    search, start, best = outcome.search, outcome.start, outcome.best
    _, name, unit = AIMS[search.aim]
    lines = [f"{f'plan within the bounds, {len(outcome.trials)} relaxations':<42}{'given':>8}{'best':>8}   bounds"]
    for bound, share in zip(search.bounds, bounded_shares(outcome.plan, search.bounds), strict=True):
        was = bounded_shares(search.plan, (bound,))[0]
        at = " (at its end)" if share in (bound.low, bound.high) else ""
        ends = f"{bound.low:g} to {bound.high:g}{at}"
        lines.append(f"{f'{bound.target} of {bound.apex}':<42}{was:>8.2f}{share:>8.2f}   {ends}")
    title = f"{name} at {start.level} [{unit}]"
    now = "" if best.level == start.level else f"   then largest at {best.level}, {best.value:.1f}"
    lines.append(f"{title:<42}{start.value:>8.1f}{best.size_at(start.level):>8.1f}{now}")
    band = WIDTH * outcome.gain_sd
    if best is start:
        lines.append("No plan within the bounds was found that is better than the plan as given.")
    else:
        gained = f"Gained: {outcome.gain:.1f} ± {band:.1f} {unit} (in 19 of 20 such operations)."
        weak = " The gain is smaller than its band: choose between the two plans by other reasons."
        lines.append(gained + weak * (outcome.gain < band))
    return "\n".join(lines)
