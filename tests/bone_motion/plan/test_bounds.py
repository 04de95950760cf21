"""Within what a plan may be changed."""

import pytest

from support.refusals import refuses
from warp_trunk.bone_motion.plan import CurvePlan, Plan
from warp_trunk.bone_motion.plan.record import Bound, bounds_of_text, check_bounds, shares_of, with_shares

PLAN = Plan(
    uiv="T4", liv="L4", curves=(CurvePlan(apex="T8", correction=0.6, derotation=0.3), CurvePlan(apex="L2"))
)


def test_bounds_as_the_command_line_has_them() -> None:
    assert bounds_of_text("T8, correction=0.5..0.8,derotation=.2..0.6") == (
        Bound(apex="T8", target="correction", low=0.5, high=0.8),
        Bound(apex="T8", target="derotation", low=0.2, high=0.6),
    )


def test_shares_of_a_plan_are_taken_and_put_back() -> None:
    bounds = bounds_of_text("T8,derotation=0.2..0.6,correction=0.5..0.8")
    assert shares_of(PLAN, bounds) == (0.3, 0.6)
    other = with_shares(PLAN, bounds, (0.4, 0.7))
    assert other.curves == (CurvePlan(apex="T8", correction=0.7, derotation=0.4), CurvePlan(apex="L2"))
    assert with_shares(other, bounds, (0.3, 0.6)) == PLAN


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("T8", "bounds nothing; write what may change, as T8,correction=0.5..0.8"),
        ("T8,correction=0.5", "must be a name, = and two numbers"),
        ("T8,cobb_after=0.1..0.2", "'cobb_after' must be correction or derotation"),
        ("T8,correction=0.8..0.5", "from a smaller share to a larger one within 0 to 1, not from 0.8 to 0.5"),
        (
            "L2,correction=0.5..0.8",
            "which is the reference of the search; give it there, as --curve L2,",
        ),
        ("T9,correction=0.5..0.8", "is not in the plan"),
        ("T8,correction=0.5..0.8,correction=0.1..0.2", "is bounded twice"),
    ],
)
def test_bad_bounds(text: str, rule: str) -> None:
    with refuses(rule, begins="--within"):
        check_bounds(PLAN, bounds_of_text(text))
