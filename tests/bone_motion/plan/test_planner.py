"""Plans for one patient from one planner: each as on its own, and the least motion that SciPy finds, too."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import optimize

from support.known_spine import known_spine
from warp_trunk.bone_motion.plan import CurvePlan, Plan, Planner, plan_surgery
from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.spline import fit_spline
from warp_trunk.geometry.surface import Surface

SPINE = known_spine(
    to_left={"T1": 0.0, "T5": 25.0, "T9": 0.0, "T12": -25.0, "L4": 0.0},
    back={"T1": -20.0, "T5": -15.0, "T12": 15.0, "L1": 15.0, "L5": -15.0},
    turned={"T4": 0.0, "T8": 18.0, "T12": 0.0},
)
CASE = Case("spine", Surface(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32)), {}, SPINE)
T9 = CurvePlan(apex="T9", correction=0.6, derotation=0.4)
PLANS = (
    Plan(uiv="T4", liv="L1", curves=(T9,)),
    Plan(uiv="T4", liv="L1", curves=(replace(T9, correction=0.95),), kyphosis_T5_T12=20.0),
    Plan(uiv="T3", liv="L4", curves=(replace(T9, derotation=None),), balance="centre", sva_after=15.0),
    Plan(uiv="T5", liv="T12", unfused="fixed", curves=(replace(T9, correction=0.5),)),
    Plan(uiv="T4", liv="L1"),
)


def test_each_plan_is_as_on_its_own() -> None:
    planner = Planner(CASE)
    for plan in (*PLANS, PLANS[0]):
        alone, kept = plan_surgery(CASE, plan), planner.plan(plan)
        np.testing.assert_array_equal(kept.landmarks_after.points, alone.landmarks_after.points)
        assert (kept.vertebrae, kept.curves, kept.warnings) == (alone.vertebrae, alone.curves, alone.warnings)


@pytest.mark.parametrize("plan", PLANS[:4])
def test_least_motion_is_that_of_scipy(plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    """By another method, a trust region over singular values of all rows."""

    def scipys(rows: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], weight: np.ndarray) -> np.ndarray:
        own = np.diag(np.sqrt(weight))

        def padded(values: np.ndarray) -> np.ndarray:
            return np.concatenate([values, np.zeros((60 - len(values), *values.shape[1:]))])

        options: dict[str, Any] = {
            "jac": lambda x: np.concatenate([own, padded(rows(x)[1])]),
            "xtol": 1e-15,
            "ftol": 1e-15,
        }
        return optimize.least_squares(
            lambda x: np.concatenate([own @ x, padded(rows(x)[0])]), np.zeros(len(weight)), **options
        ).x

    mine = plan_surgery(CASE, plan).landmarks_after.points
    monkeypatch.setattr("warp_trunk.bone_motion.plan.least_motion.least_squares", scipys)
    np.testing.assert_allclose(plan_surgery(CASE, plan).landmarks_after.points, mine, atol=2e-6)
    assert np.abs(mine - SPINE.points).max() > 5.0


def test_other_landmarks_go_by_the_spline() -> None:
    """Ribs and sternum have landmarks in some cases."""
    extra = SPINE.points[:20:5] + np.array([60.0, -50.0, 4.0])
    names = tuple(f"rib_left_0{i}_tip" for i in range(1, 5))
    order = np.random.default_rng(0).permutation(len(SPINE.names) + 4)
    both, points = (*SPINE.names, *names), np.vstack([SPINE.points, extra])
    before = Landmarks(tuple(both[i] for i in order), points[order])
    after = plan_surgery(replace(CASE, landmarks_before=before), PLANS[0]).landmarks_after
    spine = plan_surgery(CASE, PLANS[0]).landmarks_after
    expected = fit_spline(SPINE.points, spine.points)(extra)
    np.testing.assert_allclose([after.point(name) for name in names], expected, atol=1e-8)
    np.testing.assert_allclose([after.point(name) for name in SPINE.names], spine.points, atol=1e-12)
