"""The decisions of a relaxation: line searches, outcomes of solves, and the chance that a saddle was missed."""

import math

import numpy as np
import pytest

from warp_trunk.engine.certify import chance_of_saddle, response
from warp_trunk.engine.line_search import MOST_TRIALS, Trial, search
from warp_trunk.engine.outcome import LinearSolution, Outcome
from warp_trunk.engine.policy import (
    Action,
    Estimate,
    Phase,
    Reuse,
    Run,
    Saddle,
    Step,
    judge_trial,
    reach,
)
from warp_trunk.engine.relaxation import Energy
from warp_trunk.engine.state import Products


def solved(
    length: float, norm: float = 1.0, outcome: Outcome = Outcome.SOLVED, error: float = 0.0
) -> LinearSolution:
    return LinearSolution(
        outcome, iterations=10, length=length, error=error, gradient_norm=norm, residual_norm=0.1 * norm
    )


def near_the_end() -> Run:
    """After whole true steps of 0.09 mm and a hundredth of it, to a tolerance of 0.1 mm."""
    run = Run(0.1, confirm=True, saddle=Saddle(try_true=True))
    for length, norm in ((0.09, 1.0), (0.0009, 1e-4)):
        assert after(run, solved(length, norm)) is not Action.STALLED
        run.after_search(1.0)
    return run


def after(run: Run, solution: LinearSolution) -> Action:
    return run.after_solve(run.plan(), solution)


def test_the_projected_hessian_leads_to_where_the_true_one_takes_over() -> None:
    run = Run(0.1, confirm=True)
    assert (run.plan().true, run.plan().grids) == (False, True)  # the grids follow the first Hessian
    # the first step is assumed to leave two thirds; by the second the gradient has not fallen at all
    for length, norm, distance in ((5.0, 1.0, 10.0), (0.2, 1.0, 0.2 * 9.0), (0.02, 0.1, 0.02)):
        assert after(run, solved(length, norm)) is Action.SEARCH
        assert not run.plan().grids
        assert run.estimate.distance == pytest.approx(distance)
        run.after_search(1.0)
    assert (run.plan().true, run.plan().fresh, run.plan().grids) == (True, True, False)


@pytest.mark.parametrize(
    ("outcome", "norm", "is_solved"),
    [
        (Outcome.SOLVED, 0.9, True),
        (Outcome.SOLVED, 1.1, False),
        (Outcome.EXHAUSTED, 0.9, False),
        (Outcome.NEGATIVE_CURVATURE, 0.9, False),
    ],
)
def test_on_the_way_a_claim_needs_a_solve_that_ended_and_a_gradient_that_falls(
    outcome: Outcome, norm: float, is_solved: bool
) -> None:
    run = Run(2.0)
    assert after(run, solved(0.5)) is Action.SEARCH
    run.after_search(1.0)
    assert after(run, solved(0.1, norm, outcome)) is Action.SEARCH
    assert run.estimate.solved == is_solved
    assert after(run, solved(math.inf, outcome=Outcome.UNSOUND)) is Action.STALLED


def test_a_hessian_of_before_is_used_as_long_as_its_steps_are_whole_and_shrink() -> None:
    run = Run(1.0, reuse=Reuse(hessian=True))
    for length in (5.0, 2.0, 0.9):
        assert not run.plan().fresh
        assert after(run, solved(length)) is Action.SEARCH
        assert run.after_search(1.0)
    before = run.estimate.length, run.estimate.distance
    assert after(run, solved(0.5)) is Action.SOLVE  # a tetrahedron that was crushed, say
    assert (run.estimate.length, run.estimate.distance) == before
    assert run.plan().fresh
    for outcome in (Outcome.EXHAUSTED, Outcome.NEGATIVE_CURVATURE, Outcome.UNSOUND):
        run = Run(1.0, reuse=Reuse(hessian=True))
        assert after(run, solved(0.01, outcome=outcome)) is Action.SOLVE
        assert run.plan().fresh
    run = Run(1.0, reuse=Reuse(hessian=True))
    assert after(run, solved(0.4)) is Action.SEARCH
    assert run.after_search(None)
    assert run.plan().fresh
    assert not run.estimate.solved  # nothing is claimed by a step that does not lower the energy
    assert after(run, solved(0.3)) is Action.SEARCH
    assert run.estimate.distance == pytest.approx(0.6)  # as of a first step: no other was taken
    assert not run.after_search(None)


def test_negative_curvature_is_avoided_far_away_and_followed_near_the_end() -> None:
    run = Run(0.1, confirm=True, saddle=Saddle(try_true=True), estimate=Estimate(distance=8.0))
    down = solved(3.0, outcome=Outcome.NEGATIVE_CURVATURE)
    assert after(run, down) is Action.SOLVE
    assert not run.plan().true
    run.estimate.distance = 0.3
    assert after(run, down) is Action.SOLVE
    assert run.saddle.is_near
    run.saddle.try_true = True
    assert after(run, down) is Action.DESCEND
    assert (run.estimate.phase, run.estimate.distance) == (Phase.SADDLE, math.inf)
    assert run.after_search(0.5)
    assert not run.estimate.cut
    run.estimate.phase = Phase.SADDLE
    assert not run.after_search(None)


def test_the_end_is_claimed_only_with_noise_and_by_the_chance() -> None:
    run = near_the_end()
    assert after(run, solved(0.001, 1e-6)) is Action.TRY
    assert run.after_noise(solved(0.0001), 0.5, 0.0) is Action.CERTIFY
    assert run.estimate.length == pytest.approx(0.001)  # noise that cancels a part of the way makes it no shorter
    assert run.after_noise(solved(0.001), 1e-4, 0.0) is Action.CONVERGED
    assert run.after_noise(solved(0.001), 1e-4, 0.05) is Action.CONVERGED
    assert run.estimate.distance >= 0.05
    assert run.after_noise(solved(0.001), math.inf, 0.0) is Action.STALLED
    assert run.after_noise(solved(0.001, outcome=Outcome.EXHAUSTED), 1.0, 0.0) is Action.STALLED
    assert run.after_noise(solved(0.001, outcome=Outcome.NEGATIVE_CURVATURE), 1.0, 0.0) is Action.DESCEND


@pytest.mark.parametrize(("length", "hidden"), [(2.0, 0.0), (0.001, 2.0)])
def test_soft_tissue_that_only_noise_reached_makes_the_steps_before_no_evidence(
    length: float, hidden: float
) -> None:
    run = near_the_end()
    assert after(run, solved(0.001, 1e-6)) is Action.TRY
    assert run.estimate.steps
    assert run.after_noise(solved(length), 1e-4, hidden) is Action.SEARCH
    run.after_search(1.0)
    assert not run.estimate.steps
    assert after(run, solved(0.001, 1e-6)) is not Action.STALLED
    assert not run.estimate.steps  # nor is that one, which noise led astray


def test_what_is_tried_and_taken_before_a_claim() -> None:
    """Steps of more than rounding; one that leaves much of its slope or overshoots is no claim."""
    for slope, wanted in ((0.2, Action.CERTIFY), (0.3, Action.SEARCH), (3.0, Action.SEARCH)):
        assert judge_trial(-1.0, slope) is judge_trial(-1.0, -slope) is wanted
    for length, floor, wanted in (
        (1e-3, 0.0, Action.TRY),
        (1e-3, 2e-3, Action.CERTIFY),
        (1e-6, 0.0, Action.CERTIFY),
    ):
        run = near_the_end()
        run.estimate.floor = floor
        assert after(run, solved(length, 1e-6)) is wanted


def test_where_nothing_is_left_to_go() -> None:
    """The true Hessian is solved with at once; on the way nothing is claimed; rounding may still be too much."""
    run = Run(0.1, confirm=True)
    assert after(run, solved(1e-6)) is Action.SOLVE
    assert run.plan().true
    assert after(run, solved(1e-6)) is Action.CERTIFY
    assert not run.estimate.steps  # no step was taken between the two
    for other, norm, wanted in (
        (Run(0.1, confirm=True, saddle=Saddle(nearer=1e-9)), 1.0, Action.SEARCH),  # there it was indefinite
        (Run(0.1), 1.0, Action.SEARCH),
        (Run(0.1, estimate=Estimate(floor=0.01)), 0.0, Action.SEARCH),
        (Run(0.1, estimate=Estimate(floor=0.2)), 0.0, Action.STALLED),
    ):
        assert after(other, solved(1e-6 * norm, norm)) is wanted


SIZE = 60


def coefficients(matrix: np.ndarray, start: np.ndarray, iterations: int) -> tuple[np.ndarray, np.ndarray]:
    """r . r and p . A p of conjugate gradients with M = 1, up to negative curvature, written apart."""
    r, p, squares, curvatures = start.copy(), start.copy(), [], []
    for _ in range(iterations):
        squares.append(r @ r)
        curvatures.append(p @ matrix @ p)
        if curvatures[-1] <= 0.0:
            break
        r = r - squares[-1] / curvatures[-1] * (matrix @ p)
        p = r + (r @ r) / squares[-1] * p
    return np.array(squares), np.array(curvatures)


def spectrum(lowest: float, decades: float) -> np.ndarray:
    """A diagonal matrix, so that its eigenvectors are the axes."""
    return np.diag(np.append(lowest, np.logspace(-decades, 0.0, SIZE - 1)))


@pytest.mark.slow
@pytest.mark.parametrize("lowest", [-1e-6, -1e-3, -0.1])
@pytest.mark.parametrize("decades", [1.0, 3.0])
@pytest.mark.parametrize("chance", [0.3, 0.1, 0.03])
def test_saddles_are_missed_no_more_often_than_is_said(lowest: float, decades: float, chance: float) -> None:
    """Of many starts, those whose chance falls below a bound before negative curvature is met."""
    matrix, generator, missed, draws = spectrum(lowest, decades), np.random.default_rng(4), 0, 400
    for _ in range(draws):
        squares, curvatures = coefficients(matrix, generator.standard_normal(SIZE), 2 * SIZE)
        whole = int(np.argmax(curvatures <= 0.0)) if (curvatures <= 0.0).any() else len(curvatures)
        missed += any(
            chance_of_saddle(squares[:k], curvatures[:k], 1.0, 0.0) <= chance for k in range(4, whole, 4)
        )
    assert missed <= draws * chance + 3.0 * math.sqrt(draws * chance)


def test_the_bound_is_the_part_of_an_eigenvector_of_eigenvalue_0_at_most() -> None:
    """By the least residual polynomial: |q(A) v| over all q with q(0) = 1, a dense least-squares problem."""
    matrix, start = spectrum(1e-2, 2.0), np.random.default_rng(1).standard_normal(SIZE)
    squares, curvatures = coefficients(matrix, start, 12)
    powers = np.stack([np.linalg.matrix_power(matrix, k) @ start for k in range(12)], axis=1)
    least = float(np.linalg.norm(start + powers[:, 1:] @ np.linalg.lstsq(powers[:, 1:], -start, rcond=None)[0]))
    noise = 100.0 * least  # so that the chance is below 1
    least_chance = chance_of_saddle(squares, curvatures, noise, 0.0)
    assert least_chance == pytest.approx(math.sqrt(2.0 / math.pi) * least / noise, rel=1e-6)


def test_what_rounding_hides_is_not_excluded() -> None:
    start = np.random.default_rng(2).standard_normal(SIZE)
    for lowest, wanted in ((1e-3, False), (1e-9, True)):
        squares, curvatures = coefficients(spectrum(lowest, 1.0), start, 200)
        assert (chance_of_saddle(squares, curvatures, 1.0, 1e-6) == math.inf) == wanted
    assert chance_of_saddle(squares, curvatures, 0.0, 0.0) == 1.0


@pytest.mark.parametrize("lowest", [1e-2, 1e-6])
def test_the_response_to_noise_is_that_along_the_softest_direction(lowest: float) -> None:
    matrix, start = spectrum(lowest, 0.5), np.random.default_rng(3).standard_normal(SIZE)
    wanted = 1.0 / lowest / np.linalg.norm(start / np.diag(matrix))
    assert response(*coefficients(matrix, start, SIZE)) == pytest.approx(wanted, rel=1e-6)


@pytest.mark.parametrize(
    ("steps", "wanted"),
    [([], 0.6 / 0.1), ([Step(1.0, 0.6)], 0.6 / 0.4), ([Step(0.8, 0.2), Step(0.5, 0.4)], 0.6 / 0.75)],
)
def test_the_distance_is_that_within_which_there_is_an_equilibrium(steps: list[Step], wanted: float) -> None:
    """Of the newest step as long as the 0.6 mm that are left: left / (1 - q), by hand."""
    assert reach(0.6, steps, slowest=0.9) == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("first", "inverted_beyond", "finite_below", "longest"),
    [(8.0, 99.0, 99.0, 6.0), (1e6, 1e9, 1e9, 6.0), (5.0, 0.7, 99.0, 0.7), (64.0, 99.0, 4.0, 4.0)],
    ids=["beyond the valley", "far beyond it", "inverted tetrahedra", "not finite"],
)
def test_a_line_search_comes_back_to_where_the_energy_falls(
    first: float, inverted_beyond: float, finite_below: float, longest: float
) -> None:
    """From 9 at 0 down to 0 at 3."""

    def attempt(length: float) -> Trial:
        energy = Energy({"distance": (length - 3.0) ** 2 if length < finite_below else math.nan})
        inverted = int(length > inverted_beyond)
        return Trial(length, energy, inverted, inverted, Products(2.0 * (length - 3.0), 0.0, 1.0))

    step = search(attempt, first, 9.0, -6.0)
    assert step is not None
    assert 0.0 < step.length <= longest
    assert step.energy.total < 9.0


def test_a_line_search_gives_up_where_nothing_falls() -> None:
    tried: list[float] = []

    def attempt(length: float) -> Trial:
        tried.append(length)
        return Trial(length, Energy({"distance": 9.0 + length}), 0, 0, Products(1.0, 0.0, 1.0))

    assert search(attempt, 1.0, 9.0, -6.0) is None
    assert len(tried) == MOST_TRIALS
