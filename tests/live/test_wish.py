"""From sliders to a plan and back."""

from __future__ import annotations

from dataclasses import replace

import pytest

from support.small_patient import curved_case
from warp_trunk.bone_motion.plan import CurvePlan, Plan, plan_surgery
from warp_trunk.errors import InputError
from warp_trunk.live.wish import first_wish, spine_before

CASE = curved_case()
SPINE = spine_before(CASE.landmarks_before)
MAJOR = max(SPINE.curves, key=lambda curve: curve.angle)


def test_sliders_at_rest_move_nothing() -> None:
    wish = first_wish(SPINE)
    assert (wish.uiv, wish.liv) == (MAJOR.upper, MAJOR.lower)
    surgery = plan_surgery(CASE, wish.plan())
    assert surgery.landmarks_after is surgery.landmarks_before


def test_a_slider_is_the_share_of_its_curve() -> None:
    wish = replace(first_wish(SPINE), correction={MAJOR.apex: 50}, kyphosis=30)
    surgery = plan_surgery(CASE, wish.plan())
    curve = next(curve for curve in surgery.curves if curve.before == MAJOR)
    assert curve.cobb_after == pytest.approx(MAJOR.angle / 2.0, abs=0.1)
    assert surgery.measures["kyphosis T5-T12"][1] == pytest.approx(30.0, abs=0.1)
    assert wish.plan().curves[0].derotation is None  # 0 % asks for nothing


def test_a_curve_outside_the_fusion_is_not_planned() -> None:
    wish = replace(first_wish(SPINE), uiv="L1", liv="L4", correction={MAJOR.apex: 50})
    assert not wish.fuses(MAJOR.apex)
    assert wish.plan().curves == ()


def test_what_sliders_do_not_say_is_that_of_the_plan() -> None:
    given = Plan(uiv="T3", liv="L2", balance="centre", sva_after=5.0, unfused="fixed")
    plan = replace(first_wish(SPINE, given), correction={MAJOR.apex: 10}).plan(given)
    assert (plan.uiv, plan.liv, plan.balance, plan.sva_after, plan.unfused) == ("T3", "L2", "centre", 5.0, "fixed")
    assert plan.curves == (CurvePlan(apex=MAJOR.apex, correction=0.1),)


def test_sliders_begin_where_a_plan_is() -> None:
    turned = abs(SPINE.rotation[MAJOR.apex])
    curve = CurvePlan(apex=MAJOR.apex, cobb_after=MAJOR.angle * 0.35, rotation_after=turned * 0.6)
    wish = first_wish(SPINE, Plan(uiv="T3", liv="L2", curves=(curve,), kyphosis_T5_T12=31.4))
    assert (wish.correction[MAJOR.apex], wish.derotation[MAJOR.apex], wish.kyphosis) == (65, 40, 31)
    asked = first_wish(SPINE, Plan(uiv="T3", liv="L2", curves=(CurvePlan(apex=MAJOR.apex, correction=0.5),)))
    assert (asked.correction[MAJOR.apex], asked.derotation[MAJOR.apex], asked.kyphosis) == (50, 0, None)


@pytest.mark.parametrize(
    "change", [{"uiv": "L4", "liv": "T4"}, {"uiv": "<b>"}, {"correction": {MAJOR.apex: 500}}, {"kyphosis": -3}]
)
def test_what_no_slider_says_is_refused_as_a_plan(change: dict) -> None:
    """A browser can send anything."""
    with pytest.raises(InputError):
        replace(first_wish(SPINE), **change).plan()
