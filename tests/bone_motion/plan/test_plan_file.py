"""plan.toml: a plan is read, and an error is named."""

from pathlib import Path

import pytest

from support.refusals import refuses
from warp_trunk.bone_motion.plan import CurvePlan, Plan, read_plan, write_plan

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
        ('uiv = "T4"\nliv = "L1"\n[[curve]]\ncorrection = 0.5', "'curves[0]' lacks 'apex'; add it"),
        ('uiv = "T4"\nliv = "L1"\nspontaneous = "half"', "'spontaneous' must be a number, not 'half'"),
        (
            'uiv = "T4"\nliv = "L1"\n[[curve]]\napex = "T8"\ncorrection = 65',
            "'curves[0].correction' must be a number <= 1.0, not 65; for 65 % write 0.65",
        ),
        ("uiv", "cannot be read as TOML"),
        ('uiv = "L3"\nliv = "L1"', "'uiv' must lie above 'liv', but L3 is not above L1"),
        ('uiv = "T4"\nliv = "L1"\n' + 2 * '[[curve]]\napex = "T8"\n', "the curve of T8 is planned twice"),
    ],
)
def test_what_is_wrong_names_the_file(tmp_path: Path, text: str, rule: str) -> None:
    (tmp_path / "plan.toml").write_text(text)
    with refuses(rule, begins=tmp_path / "plan.toml"):
        read_plan(tmp_path / "plan.toml")
