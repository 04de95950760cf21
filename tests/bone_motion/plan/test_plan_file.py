"""plan.toml and the bounds within which a plan may be changed: they are read, and an error is named."""

from pathlib import Path

import pytest

from support.asserting import refuses
from warp_trunk.bone_motion.plan import CurvePlan, Plan, plan_words, read_plan, write_plan
from warp_trunk.bone_motion.plan.record import Bound, bounded_shares, bounds_of_text, check_bounds, with_shares

FULL = Plan(
    uiv="T4",
    liv="L1",
    curves=(
        CurvePlan(apex="T8", correction=0.65, derotation=1.0 / 3.0),
        CurvePlan(apex="L2", cobb_after=-2.0, rotation_after=7.3),
    ),
    kyphosis_T5_T12=30.0,
    lordosis_L1_L5=41.7,
    unfused="fixed",
    spontaneous=0.4,
    balance="centre",
    sva_after=-12.5,
)


@pytest.mark.parametrize("plan", [FULL, Plan(uiv="T2", liv="L4")])
def test_plan_comes_back(tmp_path: Path, plan: Plan) -> None:
    write_plan(tmp_path / "plan.toml", plan)
    assert read_plan(tmp_path / "plan.toml") == plan


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ('uiv = "T4"', "'liv' is missing"),
        ('uiv = "T4"\nliv = "L1"\nkyphosis = 30', "unknown key 'kyphosis' (did you mean 'kyphosis_T5_T12'?"),
        ('uiv = "T4"\nliv = "L1"\n[[curve]]\ncorrection = 0.5', "'curve[0]' lacks 'apex'; add it"),
        ('uiv = "T4"\nliv = "L1"\nspontaneous = "half"', "'spontaneous' must be a number, not 'half'"),
        (
            'uiv = "T4"\nliv = "L1"\n[[curve]]\napex = "T8"\ncorrection = 65',
            "'curve[0].correction' must be a number <= 1.0, not 65; for 65 % write 0.65",
        ),
        ('uiv = "T4"\nliv = "L1"\n[[curves]]\napex = "T8"', "unknown key 'curves' (did you mean 'curve'?"),
        ('uiv = "T4"\nliv = "L1"\ncurve = 3', "'curve' must be a list, not 3"),
        ("uiv", "cannot be read as TOML"),
        ('uiv = "L3"\nliv = "L1"', "'uiv' must lie above 'liv', but L3 is not above L1"),
        ('uiv = "T4"\nliv = "L1"\n' + 2 * '[[curve]]\napex = "T8"\n', "the curve of T8 is planned twice"),
    ],
)
def test_what_is_wrong_names_the_file(tmp_path: Path, text: str, rule: str) -> None:
    (tmp_path / "plan.toml").write_text(text, encoding="utf-8")
    with refuses(rule, begins=tmp_path / "plan.toml"):
        read_plan(tmp_path / "plan.toml")


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
    assert bounded_shares(PLAN, bounds) == (0.3, 0.6)
    other = with_shares(PLAN, bounds, (0.4, 0.7))
    assert other.curves == (CurvePlan(apex="T8", correction=0.7, derotation=0.4), CurvePlan(apex="L2"))
    assert with_shares(other, bounds, (0.3, 0.6)) == PLAN


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("T8", "bounds nothing; write what may change, as T8,correction=0.5..0.8"),
        ("T8,correction=0.5", "must be a name, = and two numbers"),
        ("T8,cobb_after=0.1..0.2", "'target' must be correction or derotation, not 'cobb_after'"),
        ("T8,correction=0.8..0.5", "from a smaller share to a larger one within 0 to 1, not from 0.8 to 0.5"),
        (
            "L2,correction=0.5..0.8",
            "which is the reference of the search; give it there, as --curve L2,",
        ),
        ("T9,correction=0.5..0.8", "is not in the plan"),
        ("T8,correction=0.5..0.8,correction=0.1..0.2", "is given twice"),
    ],
)
def test_bad_bounds(text: str, rule: str) -> None:
    with refuses(rule, begins="--within"):
        check_bounds(PLAN, bounds_of_text(text))


def test_words_of_a_plan() -> None:
    assert plan_words(FULL) == (
        "T4 to L1 joined (10 vertebrae); curve at T8: 65 % of the Cobb angle corrected, 33 % of the rotation "
        "corrected; curve at L2: Cobb angle -2° after, rotation 7° after; kyphosis 30°; lordosis 42°; top of "
        "the spine -12 mm in front of the sacrum; T1 over the sacrum"
    )
