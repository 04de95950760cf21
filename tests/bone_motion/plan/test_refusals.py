"""Targets that no spine can meet: one line that names the target and the nearest, which then is met."""

import re

import numpy as np
import pytest

from support.known_spine import known_spine
from warp_trunk.bone_motion.plan import CurvePlan, Plan, plan_surgery
from warp_trunk.bone_motion.plan.least_motion import rim_gaps
from warp_trunk.bone_motion.plan.spine_chain import Placed, spine_chain_of
from warp_trunk.case import Case
from warp_trunk.errors import InputError
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


@pytest.mark.parametrize("share", [0.98, 1.0])
def test_nearest_can_be_met(share: float) -> None:
    """A fusion with nothing that follows cannot be straightened wholly and keep T1 where it is."""
    plan = Plan(uiv="T5", liv="T12", unfused="fixed", curves=(CurvePlan(apex="T9", correction=share),))
    text = refusal(plan)
    assert "curve T9: Cobb angle after" in text
    reached = nearest(text)
    assert 60.0 * (1.0 - share) < reached < 60.0
    plan_surgery(
        CASE, Plan(uiv="T5", liv="T12", unfused="fixed", curves=(CurvePlan(apex="T9", cobb_after=reached + 1.0),))
    )


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
