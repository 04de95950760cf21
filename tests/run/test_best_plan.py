"""The plan that flattens the back most, on a phantom, against other plans that are simulated one by one."""

import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from support.phantoms import coarse_mesh, coarse_phantom
from warp_trunk.bone_motion.plan import CurvePlan, Plan
from warp_trunk.bone_motion.plan.record import Bound, bounds_of_text
from warp_trunk.engine.relaxation import RelaxOptions
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.errors import InputError
from warp_trunk.run.best_plan import Aim, BestPlan, PlanTrial, Search, best_plan, best_plan_text, gain_sd
from warp_trunk.run.options import RunOptions
from warp_trunk.run.patient import PreparedPatient, patient_of
from warp_trunk.run.sources import effect_of, sources_of

CASE = coarse_phantom()
PLAN = Plan(uiv="T4", liv="L1", curves=(CurvePlan(apex="T8", correction=0.5, derotation=0.3),))
BOUNDS = bounds_of_text("T8,correction=0.4..0.8,derotation=0.1..0.6")


@cache
def patient(tolerance: float = 0.01) -> PreparedPatient:
    options = RunOptions(
        mesh=coarse_mesh(),
        simulation=SimulationOptions(increments=1, relax=RelaxOptions(tolerance=tolerance)),
        precision="float32" if tolerance == 0.01 else "float64",
        device="cpu",
    )
    return patient_of(CASE, options)


@cache
def found(aim: Aim = "bsr") -> BestPlan:
    return best_plan(CASE, PLAN, BOUNDS, aim, patient=patient())


@pytest.mark.parametrize("aim", ["bsr", "hump"])
def test_slopes_against_differences_of_whole_simulations(aim: Aim) -> None:
    search, exact = Search(CASE, PLAN, aim, BOUNDS), patient(1e-6)
    trial = PlanTrial(search, exact, (0.5, 0.3))
    level, step = trial.level, 1e-3
    for place, slope in enumerate(trial.slopes()[level]):
        ends = []
        for sign in (1.0, -1.0):
            shares = [0.5, 0.3]
            shares[place] += sign * step
            ends.append(PlanTrial(search, exact, (shares[0], shares[1])).values[level])
        assert slope == pytest.approx((ends[0] - ends[1]) / (2.0 * step), rel=0.02)


@pytest.mark.slow
def test_it_is_better_than_every_plan_of_a_grid_in_few_relaxations() -> None:
    best = found()
    assert len(best.trials) < 10
    assert all(b.low <= share <= b.high for b, share in zip(BOUNDS, best.best.shares, strict=True))
    assert best.best.value < best.given.value
    assert best.gain == pytest.approx(best.given.value - best.best.value)
    grid = itertools.product((0.4, 0.6, 0.8), (0.1, 0.6))
    others = [PlanTrial(best.search, patient(), shares).value for shares in grid]
    assert best.best.value <= min(others) * 1.005


def test_a_plan_outside_the_bounds_is_told_but_not_proposed() -> None:
    bounds = (Bound(apex="T8", target="correction", low=0.1, high=0.3),)
    best = best_plan(CASE, PLAN, bounds, "bsr", patient=patient(), most=3)
    assert best.given.shares == (0.5,)
    assert best.best is best.given  # less correction flattens less
    assert best.gain == best.gain_sd == 0.0
    assert all(0.1 <= trial.shares[0] <= 0.3 for trial in best.trials[1:])
    assert "No plan within the bounds was found that is better" in best_plan_text(best)


def test_what_two_plans_share_does_not_blur_the_gain() -> None:
    """Of a plan against itself only the mesh is left where surgery meets it, and else each surgery's own miss."""
    best, trial = found(), found().given
    search = best.search
    met = replace(CASE, uncertainty=replace(CASE.uncertainty, cobb=0.0, rotation=0.0))
    met_trial = PlanTrial(replace(search, case=met), patient(), trial.shares)
    met_sd = gain_sd(replace(search, case=met), met_trial, met_trial)
    assert met_sd == pytest.approx(CASE.uncertainty.mesh_rotation, rel=1e-9)
    sources = sources_of(trial.prediction)
    missed = [effect_of(source, trial.numbers[trial.level]) for source in sources if source.of_surgery]
    assert gain_sd(search, trial, trial) == pytest.approx(np.linalg.norm([*missed, *missed, met_sd]))


def test_bounds_at_which_no_spine_can_be_placed_are_refused() -> None:
    plan = Plan(uiv="T7", liv="T10", unfused="fixed", curves=(CurvePlan(apex="T8", correction=0.05),))
    Search(CASE, plan, "hump", bounds_of_text("T8,correction=0.02..0.05")).check()
    with pytest.raises(InputError, match=r"^--within: at correction 0\.5 of T8: .* the nearest is "):
        Search(CASE, plan, "hump", bounds_of_text("T8,correction=0.02..0.5")).check()
