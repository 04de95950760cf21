"""The words and the table of the page: what they say, and that nothing from a file is markup."""

from dataclasses import replace

from support.small_trunk import APEX, curved_case
from warp_trunk.bone_motion.plan import CurvePlan, Plan, PlannedSurgery, plan_surgery
from warp_trunk.live.number_table import numbers_html
from warp_trunk.live.session import PlanView
from warp_trunk.measures import measure
from warp_trunk.measures.rows import number

CASE = curved_case()
PLAN = Plan(uiv="T4", liv="T11", curves=(CurvePlan(apex=APEX, correction=0.5),))
BEFORE = measure(CASE.skin, CASE.landmarks_before)
VIEW = PlanView(1, {}, plan_surgery(CASE, PLAN), {}, CASE.skin.vertices, error=2.34, warnings=("a < b",))


def test_the_table_has_what_the_plan_and_the_skin_have() -> None:
    text = numbers_html(CASE, BEFORE, VIEW, BEFORE)
    assert isinstance(VIEW.surgery, PlannedSurgery)
    curve = next(curve for curve in VIEW.surgery.curves if curve.planned)
    row = text[text.index(f"Cobb angle {curve.before.upper} to {curve.before.lower}") :]
    assert f"<td>{number(curve.before.angle)}</td><td>{number(curve.cobb_after)}</td>" in row[:150]
    assert "The back, of the skin relaxed last" in text  # the measures are those of another view
    assert "Look:</b> a &lt; b" in text
    assert text.count("<rect") == 2 * sum(angle is not None for angle in BEFORE.bsr.values())
    measured = replace(VIEW, relaxed=True, measures=BEFORE)
    assert "relaxed last" not in numbers_html(CASE, BEFORE, measured, BEFORE)


def test_a_plan_to_compare_with_is_a_column_of_its_own() -> None:
    kept = replace(VIEW, measures=BEFORE)
    text = numbers_html(CASE, BEFORE, kept, BEFORE, ("<mine>", kept))
    assert "&lt;mine&gt;" in text
    assert "<mine>" not in text
    assert text.count("<rect") == 3 * sum(angle is not None for angle in BEFORE.bsr.values())
