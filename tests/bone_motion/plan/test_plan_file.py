"""plan.toml and the bounds within which a plan may be changed: they are read, and an error is named."""

from pathlib import Path

import pytest

from support.shown import check_shown
from warp_trunk.bone_motion.plan import CurvePlan, Plan, plan_words, read_plan, write_plan
from warp_trunk.bone_motion.plan.record import Bound, bounded_shares, bounds_of_text, check_bounds, with_shares
from warp_trunk.errors import InputError

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


LEVELS = 'uiv = "T4"\nliv = "L1"\n'
TEXTS = (
    'uiv = "T4"',
    LEVELS + "kyphosis = 30",
    LEVELS + "[[curve]]\ncorrection = 0.5",
    LEVELS + 'spontaneous = "half"',
    LEVELS + '[[curve]]\napex = "T8"\ncorrection = 65',
    LEVELS + '[[curves]]\napex = "T8"',
    LEVELS + "curve = 3",
    'uiv = "L3"\nliv = "L1"',
    LEVELS + 2 * '[[curve]]\napex = "T8"\n',
)
BOUNDS = (
    "T8",
    "T8,correction=0.5",
    "T8,cobb_after=0.1..0.2",
    "T8,correction=0.8..0.5",
    "L2,correction=0.5..0.8",
    "T9,correction=0.5..0.8",
    "T8,correction=0.5..0.8,correction=0.1..0.2",
)


def test_refused_plans_and_bounds_are_as_accepted(tmp_path: Path) -> None:
    lines, path = list[str](), tmp_path / "plan.toml"
    for text in TEXTS:
        path.write_text(text, encoding="utf-8")
        with pytest.raises(InputError) as refusal:
            read_plan(path)
        lines += [f"== {text!r}", str(refusal.value).replace(str(path), "plan.toml")]
    for text in BOUNDS:
        with pytest.raises(InputError) as refusal:
            check_bounds(PLAN, bounds_of_text(text))
        lines.append(str(refusal.value))
    check_shown("refused_plans", lines)


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


def test_words_of_a_plan() -> None:
    assert plan_words(FULL) == (
        "T4 to L1 joined (10 vertebrae); curve at T8: 65 % of the Cobb angle corrected, 33 % of the rotation "
        "corrected; curve at L2: Cobb angle -2° after, rotation 7° after; kyphosis 30°; lordosis 42°; top of "
        "the spine -12 mm in front of the sacrum; T1 over the sacrum"
    )
