"""Plans of one patient: the least motion there is, and targets that no spine can meet, with the nearest."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize

from support.known_spine import known_spine
from warp_trunk.bone_motion.plan import CurvePlan, Plan, plan_surgery
from warp_trunk.bone_motion.plan.least_motion import least_motion, limits_of, rim_gaps, segments
from warp_trunk.bone_motion.plan.spine_chain import Placed, spine_chain_of
from warp_trunk.bone_motion.plan.targets import targets_of
from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.spline import fit_spline
from warp_trunk.geometry.surface import Surface

SPINE = known_spine(
    to_left={"T1": 0.0, "T5": 30.0, "T9": 0.0, "T12": -30.0, "L4": 0.0},
    back={"T1": -20.0, "T5": -15.0, "T12": 15.0, "L1": 15.0, "L5": -15.0},
    turned={"T4": 0.0, "T8": 18.0, "T12": 0.0},
)
CASE = Case("spine", Surface(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32)), {}, SPINE)


def refusal(plan: Plan) -> str:
    with pytest.raises(InputError) as caught:
        plan_surgery(CASE, plan)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def nearest(text: str) -> float:
    found = re.search(r"the nearest is (-?[\d.]+)", text)
    assert found is not None, text
    return float(found[1])


@pytest.mark.slow
def test_nearest_can_be_met() -> None:
    """A fusion with nothing that follows cannot be straightened wholly and keep T1 where it is."""
    plan = Plan(uiv="T5", liv="T12", unfused="fixed", curves=(CurvePlan(apex="T9", correction=1.0),))
    text = refusal(plan)
    assert "curve T9: Cobb angle after" in text
    reached = nearest(text)
    assert 0.0 < reached < 60.0
    plan_surgery(CASE, replace(plan, curves=(CurvePlan(apex="T9", cobb_after=reached + 1.0),)))


def test_target_of_segments_that_stay() -> None:
    text = refusal(Plan(uiv="T4", liv="T12", unfused="fixed", lordosis_L1_L5=40.0))
    assert "lordosis_L1_L5 40 degrees cannot be met" in text
    assert nearest(text) == pytest.approx(30.0, abs=0.5)


def test_height_of_a_disc_at_its_rim() -> None:
    """Against the least height over points on both rims."""
    chain = spine_chain_of(SPINE)
    change = np.random.default_rng(3).normal(scale=6.0, size=chain.angles.shape)
    placed = Placed(chain, change)
    circle = np.linspace(0.0, 2.0 * np.pi, 20000)
    for row, gap in enumerate(rim_gaps(placed)):
        upper, lower, disc = placed.axes[row], placed.axes[row + 1], placed.discs[row]
        least = []
        for normal, across, sign in ((lower, upper, 1.0), (upper, lower, -1.0)):
            side = np.cross(across, [1.0, 0.0, 0.0])
            side /= np.linalg.norm(side)
            rim = 12.0 * (np.outer(np.cos(circle), side) + np.outer(np.sin(circle), np.cross(across, side)))
            least.append(float((sign * (sign * disc + rim) @ normal).min()))
        assert gap == pytest.approx(min(least), abs=1e-6)


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


PLAN = Plan(uiv="T4", liv="L1", curves=(CurvePlan(apex="T9", correction=0.6, derotation=0.4),))


def test_other_landmarks_go_by_the_spline() -> None:
    """Ribs and sternum have landmarks in some cases."""
    extra = SPINE.points[:20:5] + np.array([60.0, -50.0, 4.0])
    names = tuple(f"rib_left_0{i}_tip" for i in range(1, 5))
    order = np.random.default_rng(0).permutation(len(SPINE.names) + 4)
    both, points = (*SPINE.names, *names), np.vstack([SPINE.points, extra])
    before = Landmarks(tuple(both[i] for i in order), points[order])
    after = plan_surgery(replace(CASE, landmarks_before=before), PLAN).landmarks_after
    spine = plan_surgery(CASE, PLAN).landmarks_after
    expected = fit_spline(SPINE.points, spine.points)(extra)
    np.testing.assert_allclose([after.point(name) for name in names], expected, atol=1e-8)
    np.testing.assert_allclose([after.point(name) for name in SPINE.names], spine.points, atol=1e-12)
