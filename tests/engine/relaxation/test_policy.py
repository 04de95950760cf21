"""The decisions of a relaxation: line searches, outcomes of solves, and the chance that a saddle was missed."""

import math
from collections.abc import Callable

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
        assert run.after_solve(run.plan(), solved(length, norm)) is not Action.STALLED
        run.after_search(1.0)
    return run


def test_the_projected_hessian_leads_to_where_the_true_one_takes_over() -> None:
    run = Run(0.1, confirm=True)
    assert (run.plan().true, run.plan().grids) == (False, True)  # the grids follow the first Hessian
    assert run.after_solve(run.plan(), solved(5.0)) is Action.SEARCH
    assert not run.plan().grids
    assert run.estimate.distance == pytest.approx(10.0)  # the first step is assumed to leave two thirds
    run.after_search(1.0)
    assert run.after_solve(run.plan(), solved(0.2)) is Action.SEARCH
    assert run.estimate.distance == pytest.approx(0.2 * 9.0)  # the gradient has not fallen at all
    run.after_search(1.0)
    assert run.after_solve(run.plan(), solved(0.02, norm=0.1)) is Action.SEARCH
    assert run.estimate.distance == pytest.approx(0.02)
    run.after_search(1.0)
    assert (run.plan().true, run.plan().fresh, run.plan().grids) == (True, True, False)


def test_on_the_way_a_claim_needs_a_solve_that_ended() -> None:
    for outcome, is_solved in (
        (Outcome.SOLVED, True),
        (Outcome.EXHAUSTED, False),
        (Outcome.NEGATIVE_CURVATURE, False),
    ):
        run = Run(2.0)
        assert run.after_solve(run.plan(), solved(0.01, outcome=outcome)) is Action.SEARCH
        assert run.estimate.solved == is_solved
    assert run.after_solve(run.plan(), solved(math.inf, outcome=Outcome.UNSOUND)) is Action.STALLED


def test_a_hessian_of_before_is_used_as_long_as_its_steps_are_whole_and_shrink() -> None:
    run = Run(1.0, reuse=Reuse(hessian=True))
    for length in (5.0, 2.0, 0.9):
        assert not run.plan().fresh
        assert run.after_solve(run.plan(), solved(length)) is Action.SEARCH
        assert run.after_search(1.0)
    before = run.estimate.length, run.estimate.distance
    assert run.after_solve(run.plan(), solved(0.5)) is Action.SOLVE  # a tetrahedron that was crushed, say
    assert (run.estimate.length, run.estimate.distance) == before
    assert run.plan().fresh


@pytest.mark.parametrize("outcome", [Outcome.EXHAUSTED, Outcome.NEGATIVE_CURVATURE, Outcome.UNSOUND])
def test_a_solve_with_a_hessian_of_before_that_did_not_end_is_not_believed(outcome: Outcome) -> None:
    run = Run(1.0, reuse=Reuse(hessian=True))
    assert run.after_solve(run.plan(), solved(0.01, outcome=outcome)) is Action.SOLVE
    assert run.plan().fresh


def test_a_step_with_a_hessian_of_before_that_is_not_taken_whole_is_solved_for_anew() -> None:
    run = Run(1.0, reuse=Reuse(hessian=True))
    assert run.after_solve(run.plan(), solved(0.4)) is Action.SEARCH
    assert run.estimate.solved
    assert run.after_search(None)
    assert run.plan().fresh
    assert not run.estimate.solved  # nothing is claimed by a step that does not lower the energy
    assert run.after_solve(run.plan(), solved(0.3)) is Action.SEARCH
    assert run.estimate.distance == pytest.approx(0.6)  # as of a first step: no other was taken
    assert not run.after_search(None)


def test_on_the_way_a_claim_needs_a_gradient_that_falls() -> None:
    for norm, is_solved in ((0.9, True), (1.1, False)):
        run = Run(2.0)
        assert run.after_solve(run.plan(), solved(0.5)) is Action.SEARCH
        run.after_search(1.0)
        assert run.after_solve(run.plan(), solved(0.1, norm)) is Action.SEARCH
        assert run.estimate.solved == is_solved


def test_negative_curvature_is_avoided_far_away_and_followed_near_the_end() -> None:
    run = Run(0.1, confirm=True, saddle=Saddle(try_true=True), estimate=Estimate(distance=8.0))
    down = solved(3.0, outcome=Outcome.NEGATIVE_CURVATURE)
    assert run.after_solve(run.plan(), down) is Action.SOLVE
    assert not run.plan().true
    run.estimate.distance = 0.3
    assert run.after_solve(run.plan(), down) is Action.SOLVE
    assert run.saddle.is_near
    run.saddle.try_true = True
    assert run.after_solve(run.plan(), down) is Action.DESCEND
    assert (run.estimate.phase, run.estimate.distance) == (Phase.SADDLE, math.inf)
    assert run.after_search(0.5)
    assert not run.estimate.cut
    run.estimate.phase = Phase.SADDLE
    assert not run.after_search(None)


def test_the_end_is_claimed_only_with_noise_and_by_the_chance() -> None:
    run = near_the_end()
    assert run.after_solve(run.plan(), solved(0.001, 1e-6)) is Action.TRY
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
    assert run.after_solve(run.plan(), solved(0.001, 1e-6)) is Action.TRY
    assert run.estimate.steps
    assert run.after_noise(solved(length), 1e-4, hidden) is Action.SEARCH
    run.after_search(1.0)
    assert not run.estimate.steps
    assert run.after_solve(run.plan(), solved(0.001, 1e-6)) is not Action.STALLED
    assert not run.estimate.steps  # nor is that one, which noise led astray


@pytest.mark.parametrize(("after", "wanted"), [(0.2, Action.CERTIFY), (0.3, Action.SEARCH), (3.0, Action.SEARCH)])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_step_that_leaves_much_of_its_slope_or_overshoots_is_taken_before_a_claim(
    side: float, after: float, wanted: Action
) -> None:
    assert judge_trial(-1.0, side * after) is wanted


@pytest.mark.parametrize(
    ("length", "floor", "wanted"),
    [(1e-3, 0.0, Action.TRY), (1e-3, 2e-3, Action.CERTIFY), (1e-6, 0.0, Action.CERTIFY)],
)
def test_only_steps_of_more_than_rounding_are_tried(length: float, floor: float, wanted: Action) -> None:
    run = near_the_end()
    run.estimate.floor = floor
    assert run.after_solve(run.plan(), solved(length, 1e-6)) is wanted


def test_where_the_projected_hessian_leads_nowhere_the_true_one_is_solved_with_at_once() -> None:
    run = Run(0.1, confirm=True)
    assert run.after_solve(run.plan(), solved(1e-6)) is Action.SOLVE
    assert run.plan().true
    assert run.after_solve(run.plan(), solved(1e-6)) is Action.CERTIFY
    assert not run.estimate.steps  # no step was taken between the two
    run = Run(0.1, confirm=True, saddle=Saddle(nearer=1e-9))  # there it was indefinite
    assert run.after_solve(run.plan(), solved(1e-6)) is Action.SEARCH
    run = Run(0.1)  # on the way nothing is claimed
    assert run.after_solve(run.plan(), solved(1e-6)) is Action.SEARCH


def test_nothing_is_searched_for_where_no_force_is_left() -> None:
    """Rounding may still be farther than the tolerance."""
    for floor, wanted in ((0.2, Action.STALLED), (0.01, Action.SEARCH)):
        run = Run(0.1, estimate=Estimate(floor=floor))
        assert run.after_solve(run.plan(), solved(0.0, norm=0.0)) is wanted


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


def trial(length: float, energy: float, slope: float, forbidden: int = 0) -> Trial:
    products = Products(slope, 0.0, 1.0)
    return Trial(length, Energy({"distance": energy}), forbidden, forbidden, products)


def along(
    energy: Callable[[float], float], slope: Callable[[float], float], inverted_beyond: float = math.inf
) -> tuple[Callable[[float], Trial], list[float]]:
    """An `attempt` on a function of the length, and the lengths it was asked for."""
    tried: list[float] = []

    def attempt(length: float) -> Trial:
        tried.append(length)
        return trial(length, energy(length), slope(length), int(length > inverted_beyond))

    return attempt, tried


@pytest.mark.parametrize("first", [8.0, 1e6])
def test_comes_back_from_beyond_the_valley(first: float) -> None:
    attempt, _ = along(lambda x: (x - 3.0) ** 2, lambda x: 2.0 * (x - 3.0))
    step = search(attempt, first, 9.0, -6.0)
    assert step is not None
    assert 0.0 < step.length < 6.0


def test_never_ends_where_a_tetrahedron_would_invert() -> None:
    attempt, _ = along(lambda x: (x - 3.0) ** 2, lambda x: 2.0 * (x - 3.0), inverted_beyond=0.7)
    step = search(attempt, 5.0, 9.0, -6.0)
    assert step is not None
    assert 0.0 < step.length <= 0.7


def test_comes_back_from_numbers_that_are_not_finite() -> None:
    attempt, _ = along(lambda x: (x - 3.0) ** 2 if x < 4.0 else math.nan, lambda x: 2.0 * (x - 3.0))
    step = search(attempt, 64.0, 9.0, -6.0)
    assert step is not None
    assert step.energy.total < 9.0


def test_gives_up_where_nothing_falls() -> None:
    attempt, tried = along(lambda x: 9.0 + x, lambda x: 1.0)
    step = search(attempt, 1.0, 9.0, -6.0)
    assert step is None
    assert len(tried) == MOST_TRIALS
