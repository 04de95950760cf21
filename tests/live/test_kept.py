"""Plans that are kept are cases as `plan` writes them, whole or not there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support.small_patient import APEX, curved_case
from warp_trunk.bone_motion.plan import CurvePlan, Plan, PlannedSurgery, plan_surgery, read_plan
from warp_trunk.case.landmarks import read_landmarks
from warp_trunk.errors import InputError
from warp_trunk.live.kept import KeptPlans
from warp_trunk.live.session import PlanView
from warp_trunk.live.wish import first_wish, spine_before

FILES = {"bones", "case.toml", "landmarks_after.csv", "landmarks_before.csv", "plan.json", "plan.toml", "skin.ply"}


def view(number: int = 1) -> PlanView:
    case = curved_case()
    plan = Plan(uiv="T4", liv="T11", curves=(CurvePlan(apex=APEX, correction=0.5),))
    return PlanView(
        number=number,
        wish=first_wish(spine_before(case.landmarks_before), plan),
        surgery=plan_surgery(case, plan),
        motions=None,
        skin=case.skin.vertices,
        relaxed=False,
        error=None,
        measures=None,
        warnings=(),
    )


def test_a_kept_plan_is_the_planned_case(tmp_path: Path) -> None:
    kept, shown = KeptPlans(tmp_path / "plans", curved_case()), view()
    assert kept.free_name() == "plan_1"
    folder = kept.keep("plan_1", shown)
    assert folder == tmp_path / "plans" / "plan_1"
    assert {path.name for path in folder.iterdir()} == FILES
    assert isinstance(shown.surgery, PlannedSurgery)
    assert read_plan(folder / "plan.toml") == shown.surgery.plan
    after = read_landmarks(folder / "landmarks_after.csv")
    np.testing.assert_array_equal(after.points, shown.surgery.landmarks_after.points)
    assert ", plan plan_1" in (folder / "case.toml").read_text()
    assert (kept.free_name(), kept.names, kept.get("plan_1")) == ("plan_2", ("plan_1",), shown)
    better = view()
    kept.improve(view(2))
    assert kept.get("plan_1") is shown  # another wish
    kept.improve(better)
    assert kept.get("plan_1") is better


@pytest.mark.parametrize("name", ["", "..", "a/b", ".hidden", "a b", "x" * 61, "<b>"])
def test_a_name_that_no_folder_should_have_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="cannot name a plan"):
        KeptPlans(tmp_path, curved_case()).keep(name, view())
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_is_not_overwritten_and_a_full_disk_is_told(tmp_path: Path) -> None:
    kept = KeptPlans(tmp_path, curved_case())
    kept.keep("mine", view())
    with pytest.raises(InputError, match="'mine' is there already"):
        kept.keep("mine", view())
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="nothing was kept"):
        KeptPlans(tmp_path / "file", curved_case()).keep("mine", view())


def test_plans_of_before_are_found_and_no_others(tmp_path: Path) -> None:
    first = KeptPlans(tmp_path / "none", curved_case())
    assert (first.names, first.plan("mine")) == ((), None)
    KeptPlans(tmp_path, curved_case()).keep("mine", view())
    moved = replace(curved_case().landmarks_before, points=curved_case().landmarks_before.points + 1.0)
    KeptPlans(tmp_path, replace(curved_case(), landmarks_before=moved)).keep("hers", view())
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "plan.toml").write_text("no plan")
    (tmp_path / "mine" / "case.toml").rename(tmp_path / "case.toml")
    assert KeptPlans(tmp_path, curved_case()).names == ()  # without it a folder is not whole
    (tmp_path / "case.toml").rename(tmp_path / "mine" / "case.toml")
    again = KeptPlans(tmp_path, curved_case())
    assert (again.names, again.new_names, again.get("mine")) == (("mine",), (), None)
    shown = view()
    assert isinstance(shown.surgery, PlannedSurgery)
    assert again.plan("mine") == shown.surgery.plan
    again.found("mine", shown)
    again.keep("next", shown)
    assert (again.get("mine"), again.names, again.new_names) == (shown, ("mine", "next"), ("next",))
