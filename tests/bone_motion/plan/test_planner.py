"""Plans for one patient from one planner: each as on its own, by the least motion there is."""

from dataclasses import replace

import numpy as np
from scipy import optimize

from support.known_spine import known_spine
from warp_trunk.bone_motion.plan import CurvePlan, Plan, plan_surgery
from warp_trunk.bone_motion.plan.least_motion import least_motion, limits_of, segments
from warp_trunk.bone_motion.plan.spine_chain import Placed, spine_chain_of
from warp_trunk.bone_motion.plan.targets import targets_of
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


def test_least_motion_is_that_of_sequential_quadratic_programming() -> None:
    """The sum of s^2 / b over T4 to L4 under targets without a proportional part."""
    chain = spine_chain_of(SPINE)
    free = np.array([level in SPINE.vertebrae()[3:15] for level in chain.levels])
    plan = Plan(uiv="T4", liv="L4", unfused="fixed", kyphosis_T5_T12=40.0, sva_after=5.0)
    targets = targets_of(chain, plan, ())
    mine = least_motion(limits_of(chain), targets, free)
    still = chain.angles - chain.angles[-1] * [0.0, 1.0, 0.0]
    bend = np.abs(segments(still)[free]) + 1.0
    bend[:, 1] = 3.0

    def change(s: np.ndarray) -> np.ndarray:
        found = np.zeros_like(mine)
        found[free] = s.reshape(-1, 3)
        return np.cumsum(found[::-1], axis=0)[::-1]

    def cost(s: np.ndarray) -> float:
        return float((s**2 / bend.ravel()).sum() + (100.0 * change(s)[0, 2]) ** 2)

    def off(s: np.ndarray) -> np.ndarray:
        return np.array([target.off(Placed(chain, change(s))) for target in targets])

    met = {"type": "eq", "fun": off}
    theirs = optimize.minimize(
        cost, np.zeros(bend.size), method="SLSQP", constraints=met, options={"maxiter": 500, "ftol": 1e-12}
    )
    assert np.abs(off(theirs.x)).max() < 1e-6
    np.testing.assert_allclose(mine, change(theirs.x), atol=5e-3)
    assert np.abs(mine).max() > 3.0


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
