"""The decisions of a relaxation, from outcomes of solves alone: no device, milliseconds."""

import math

import numpy as np
import pytest

from warp_trunk.engine.linear import LinearSolution, Outcome
from warp_trunk.engine.policy import Action, Phase, Run, decide, decide_claim, decide_end, plan, searched


def solved(
    length: float, norm: float = 1.0, outcome: Outcome = Outcome.SOLVED, error: float = 0.0
) -> LinearSolution:
    return LinearSolution(outcome, iterations=10, length=length, error=error, norm=norm, left=0.1 * norm)


def near_the_end() -> Run:
    """After whole true steps of 0.09 mm and a hundredth of it, to a tolerance of 0.1 mm."""
    run = Run(0.1, confirm=True, try_true=True)
    for length, norm in ((0.09, 1.0), (0.0009, 1e-4)):
        assert decide(run, plan(run), solved(length, norm)) is not Action.STALLED
        searched(run, 1.0)
    return run


def test_the_projected_hessian_leads_to_where_the_true_one_takes_over() -> None:
    run = Run(0.1, confirm=True)
    assert (plan(run).true, plan(run).grids) == (False, True)  # the grids follow the first Hessian
    assert decide(run, plan(run), solved(5.0)) is Action.SEARCH
    assert not plan(run).grids
    assert run.distance == pytest.approx(10.0)  # the first step is assumed to leave two thirds
    searched(run, 1.0)
    assert decide(run, plan(run), solved(0.2)) is Action.SEARCH
    assert run.distance == pytest.approx(0.2 * 9.0)  # the gradient has not fallen at all
    searched(run, 1.0)
    assert decide(run, plan(run), solved(0.02, norm=0.1)) is Action.SEARCH
    assert run.distance == pytest.approx(0.02)
    searched(run, 1.0)
    assert (plan(run).true, plan(run).fresh, plan(run).grids) == (True, True, False)


def test_on_the_way_a_claim_needs_a_solve_that_ended() -> None:
    for outcome, known in (
        (Outcome.SOLVED, True),
        (Outcome.EXHAUSTED, False),
        (Outcome.NEGATIVE_CURVATURE, False),
    ):
        run = Run(2.0)
        assert decide(run, plan(run), solved(0.01, outcome=outcome)) is Action.SEARCH
        assert run.known == known
    assert decide(run, plan(run), solved(math.inf, outcome=Outcome.UNSOUND)) is Action.STALLED


def test_few_iterations_are_expected_of_the_first_solve_from_near_the_last_end() -> None:
    run = Run(1.0, reuse=True)
    assert (plan(run).short, plan(run).fresh) == (True, False)
    assert decide(run, plan(run), solved(5.0)) is Action.SEARCH
    searched(run, 1.0)
    assert not plan(run).short
    assert not plan(Run(1.0)).short


def test_negative_curvature_is_avoided_far_away_and_followed_near_the_end() -> None:
    run = Run(0.1, confirm=True, try_true=True, distance=8.0)
    down = solved(3.0, outcome=Outcome.NEGATIVE_CURVATURE)
    assert decide(run, plan(run), down) is Action.SOLVE
    assert not plan(run).true
    run.distance = 0.3
    assert decide(run, plan(run), down) is Action.SOLVE
    assert run.at_saddle
    run.try_true = True
    assert decide(run, plan(run), down) is Action.DESCEND
    assert (run.phase, run.distance) == (Phase.SADDLE, math.inf)
    assert searched(run, 0.5)
    assert not run.cut
    run.phase = Phase.SADDLE
    assert not searched(run, None)


def test_the_end_is_claimed_only_with_noise_and_by_the_chance() -> None:
    run = near_the_end()
    assert decide(run, plan(run), solved(0.001, 1e-6)) is Action.CERTIFY
    assert decide_end(run, solved(0.0001), 0.5) is Action.CERTIFY
    assert run.length == pytest.approx(0.001)  # noise that cancels a part of the way makes it no shorter
    assert decide_end(run, solved(0.001), 1e-4) is Action.CONVERGED
    assert decide_end(run, solved(2.0), 1e-4) is Action.SEARCH  # soft tissue that the solve had not reached
    assert decide_end(run, solved(0.001), math.inf) is Action.STALLED
    assert decide_end(run, solved(0.001, outcome=Outcome.EXHAUSTED), 1.0) is Action.STALLED
    assert decide_end(run, solved(0.001, outcome=Outcome.NEGATIVE_CURVATURE), 1.0) is Action.DESCEND


def test_a_step_that_leaves_most_of_its_slope_is_taken_before_a_claim() -> None:
    assert decide_claim(-1.0, -0.2, fall=0.6, rounding=1e-7) is Action.CONVERGED
    assert decide_claim(-1.0, -0.3, fall=0.8, rounding=1e-7) is Action.SEARCH
    assert decide_claim(-1.0, -0.3, fall=0.8, rounding=1.0) is Action.CONVERGED  # slopes of rounding say nothing


def test_a_run_begins_with_nothing_of_another() -> None:
    one = near_the_end()
    one.down = np.ones((2, 3))
    fresh = Run(0.1)
    assert (fresh.steps, fresh.down, fresh.distance) == ([], None, math.inf)
