"""The best plan within bounds: where the optimum is known, how sure the gain is, and its derivatives."""

import io
import math
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest

from support.asserting import refuses
from support.known_spine import LEVELS
from support.shown import check_shown
from support.small_patient import small_patient
from warp_trunk.bone_motion.plan import CurvePlan, Plan
from warp_trunk.bone_motion.plan.record import Bound, bounds_of_text
from warp_trunk.case import Case
from warp_trunk.case.uncertainty import Uncertainty
from warp_trunk.engine.relaxation import RelaxOptions
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.errors import InputError
from warp_trunk.run import best_plan as searching
from warp_trunk.run.best_plan import Aim, BestPlan, PlanTrial, Search, best_plan, best_plan_text, gain_sd
from warp_trunk.run.options import Execution, RunOptions
from warp_trunk.run.patient import PreparedPatient, patient_of
from warp_trunk.run.progress import Progress
from warp_trunk.run.sources import ErrorSource

CASE = small_patient(LEVELS)[0]
PLAN = Plan(uiv="T4", liv="L1", curves=(CurvePlan(apex="T7", correction=0.3, derotation=0.1),))
BOUNDS = bounds_of_text("T7,correction=0.2..0.8,derotation=0.1..0.6")


class KnownTrial(PlanTrial):
    """A trial whose largest numbers are functions of its shares: least is 15, to either side, at 0.5 and 0.4."""

    def __init__(self, search: Search, patient: Any, shares: tuple[float, ...]) -> None:
        correction, derotation = self.shares = shares
        self.values = {
            "T8": 30.0 * (1.0 - correction) + 8.0 * (derotation - 0.4) ** 2,
            "T9": 3.0,
            "L1": -6.0 - 18.0 * correction,
        }

    def slopes(self) -> dict[str, np.ndarray]:
        return {"T8": np.array([-30.0, 16.0 * (self.shares[1] - 0.4)]), "L1": np.array([-18.0, 0.0])}


@pytest.fixture
def prepared(monkeypatch: pytest.MonkeyPatch) -> list[Case]:
    """The cases that are made ready for a search in which nothing is simulated."""
    made: list[Case] = []

    def ready(case: Case, *_: Any, **__: Any) -> Any:
        made.append(case)
        return SimpleNamespace(case=replace(case, name="ready"))

    monkeypatch.setattr(searching, "PlanTrial", KnownTrial)
    monkeypatch.setattr(searching, "patient_of", ready)
    monkeypatch.setattr(searching, "gain_sd", lambda search, start, best: best.value / start.value)
    return made


def test_the_search_ends_where_the_largest_number_to_either_side_is_least(prepared: list[Case]) -> None:
    best = best_plan(CASE, PLAN, ["T7,correction=0.2..0.8", BOUNDS[1]], "hump", most=40)
    assert prepared == [CASE]
    assert best.search.case.name == "ready"
    assert best.start.shares == (0.3, 0.1)
    assert best.best.shares == pytest.approx((0.5, 0.4), abs=0.02)
    assert best.best.value == pytest.approx(15.0, rel=2e-3)
    assert best.gain == pytest.approx(best.start.value - best.best.values["T8"])
    assert best.gain_sd == best.best.value / best.start.value
    assert best.plan.curves[0].correction == best.best.shares[0]
    assert len({trial.shares for trial in best.trials}) == len(best.trials) < 15


@pytest.mark.parametrize("most", [1, 3])
def test_a_search_tries_no_more_plans_than_it_may_and_keeps_to_its_bounds(prepared: list[Case], most: int) -> None:
    """The plan as given lies outside of them; what flattens less is not proposed."""
    bounds = Bound(apex="T7", target="correction", low=0.05, high=0.2), BOUNDS[1]
    best = best_plan(CASE, PLAN, bounds, "hump", most=most)
    assert len(best.trials) == most
    assert best.start.shares == (0.3, 0.1)
    assert all(0.05 <= trial.shares[0] <= 0.2 for trial in best.trials[1:])
    assert best.best is best.start
    assert best.gain == best.gain_sd == 0.0
    assert best.plan.curves[0].correction == 0.3


def test_what_a_search_shows_is_as_accepted(prepared: list[Case]) -> None:
    """The plans as they come, and in the end those of two searches: one that gained, one that did not."""
    texts: list[str] = []
    for aim in get_args(Aim):
        stream = io.StringIO()
        best = best_plan(CASE, PLAN, BOUNDS, aim, progress=Progress(stream), most=1)
        texts += [re.sub(r": [\d.]+ s$", "", stream.getvalue(), flags=re.MULTILINE), best_plan_text(best)]
        start = best.start
        for shares, gain, sd in (((0.5, 0.4), 6.0, 2.0), ((0.8, 0.1), 1.2, 1.5)):
            other: Any = KnownTrial(best.search, None, shares)
            plan = replace(PLAN, curves=(CurvePlan("T7", correction=shares[0], derotation=shares[1]),))
            texts.append(best_plan_text(BestPlan(best.search, plan, start, other, (start, other), gain, sd)))
    check_shown("best_plan", texts)


def test_what_two_plans_share_does_not_blur_the_gain(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hump on the left that is smaller on the right: each number is counted by its size.

    Surgery misses each plan by itself (3 and 4), errors of the patient count where they differ (5 and 1).
    """
    ways = np.zeros((2, *CASE.landmarks_before.points.shape))
    ways[0, 3, 1], ways[1, 5, 2] = 6.0, 2.0
    numbers = {
        name: SimpleNamespace(value=value, landmarks_before=sign * ways[0], landmarks_after=sign * own * ways[1],
                              constants={"theta": sign * theta, "missed": missed}, bones=None)
        for name, value, sign, own, theta, missed in (
            ("start", -20.0, -1.0, 3.0, 5.0, 3.0), ("best", 10.0, 1.0, 1.0, 1.0, 4.0),
        )
    }  # fmt: skip
    sources = (
        ErrorSource("theta", "", "", constants={"theta": 1.0}),
        ErrorSource("surgery", "", "", of_surgery=True, constants={"missed": 1.0}),
    )
    monkeypatch.setattr(searching, "sources_of", lambda _: sources)
    start, best = (
        SimpleNamespace(level="T8", numbers={"T8": number}, prediction=None) for number in numbers.values()
    )
    sure = Uncertainty(landmark_error=1.5, landmark_error_sd=0.0, mesh_length=0.5, mesh_rotation=0.2)
    by_landmarks = sure.landmark_sd * 4.0  # 2 mm, three times in one and once in the other
    for aim, mesh in (("hump", 0.5), ("bsr", 0.2)):
        search: Any = SimpleNamespace(case=replace(CASE, uncertainty=sure), aim=aim)
        wanted = math.sqrt(3.0**2 + 4.0**2 + (5.0 - 1.0) ** 2 + by_landmarks**2 + mesh**2)
        assert gain_sd(search, start, best) == pytest.approx(wanted)  # pyright: ignore[reportArgumentType]


@cache
def patient() -> PreparedPatient:
    case, mesh = small_patient(LEVELS[1:15])
    relax = SimulationOptions(increments=1, relax=RelaxOptions(tolerance=1e-6))
    options = RunOptions(bones="spline", precision="float64", layers="none", simulation=relax)
    return patient_of(case, options, mesh, execution=Execution(device="cpu", threads=1))


def test_slopes_of_the_hump_of_every_level_against_differences_of_simulations() -> None:
    search = Search(patient().case, replace(PLAN, uiv="T5"), "hump", BOUNDS)
    trial, step = PlanTrial(search, patient(), (0.5, 0.3)), 2e-3
    slopes = trial.slopes()
    assert slopes.keys() >= trial.values.keys()
    for place in range(2):
        ends = []
        for sign in (1.0, -1.0):
            shares = [0.5, 0.3]
            shares[place] += sign * step
            ends.append(PlanTrial(search, patient(), (shares[0], shares[1])).values)
        wanted = np.array([(ends[0][level] - ends[1][level]) / (2.0 * step) for level in trial.values])
        got = [slopes[level][place] for level in trial.values]
        np.testing.assert_allclose(got, wanted, atol=0.03 * np.abs(wanted).max())


def test_a_real_search_lowers_its_aim() -> None:
    best = best_plan(patient(), replace(PLAN, uiv="T5"), BOUNDS, "bsr", most=2)
    assert best.best.value <= best.start.value
    with refuses("a patient made ready has her options; leave 'options' and 'execution' out"):
        best_plan(patient(), PLAN, BOUNDS, options=RunOptions())


def test_bounds_at_which_no_spine_can_be_placed_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each end of one bound with each of the other; the plans themselves are refused in tests of the planner."""
    search, asked = Search(CASE, PLAN, "hump", BOUNDS), set[tuple[float, ...]]()
    search.check()

    def planned(_: Search, shares: Sequence[float]) -> Case:
        asked.add(tuple(shares))
        if shares[1] > 0.5:
            raise InputError("plan: no spine has it")
        return CASE

    monkeypatch.setattr(Search, "planned", planned)
    with refuses(begins="--within: at correction 0.2 of T7, derotation 0.6 of T7: no spine has it"):
        search.check()
    replace(search, bounds=(BOUNDS[0], replace(BOUNDS[1], high=0.5))).check()
    assert asked >= {(0.2, 0.1), (0.2, 0.5), (0.8, 0.1), (0.8, 0.5)}
    with refuses("T9"):
        replace(search, bounds=(Bound(apex="T9", target="correction", low=0.1, high=0.2),)).check()
