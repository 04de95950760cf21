"""Plans that are kept are cases as `plan` writes them; the words and the table of the page."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support.small_trunk import APEX, curved_case
from warp_trunk.bone_motion.plan import CurvePlan, Plan, PlannedSurgery, plan_surgery, read_plan
from warp_trunk.case.landmarks import read_landmarks
from warp_trunk.errors import InputError
from warp_trunk.live.kept import KeptPlans
from warp_trunk.live.number_table import numbers_html
from warp_trunk.live.session import PlanView
from warp_trunk.measures import measure
from warp_trunk.measures.rows import number

FILES = {"bones", "case.toml", "landmarks_after.csv", "landmarks_before.csv", "plan.json", "plan.toml", "skin.ply"}
CASE = curved_case()
SURGERY = plan_surgery(CASE, Plan(uiv="T4", liv="T11", curves=(CurvePlan(apex=APEX, correction=0.5),)))


def view(number: int = 1) -> PlanView:
    return PlanView(number, {}, SURGERY, {}, CASE.skin.vertices)


def test_a_kept_plan_is_the_planned_case(tmp_path: Path) -> None:
    kept, shown = KeptPlans(tmp_path / "plans", CASE), view()
    folder = kept.keep(kept.free_name(), shown)
    assert folder == tmp_path / "plans" / "plan_1"
    assert {path.name for path in folder.iterdir()} == FILES
    assert isinstance(shown.surgery, PlannedSurgery)
    assert read_plan(folder / "plan.toml") == SURGERY.plan
    after = read_landmarks(folder / "landmarks_after.csv")
    np.testing.assert_array_equal(after.points, SURGERY.landmarks_after.points)
    assert ", plan plan_1" in (folder / "case.toml").read_text()
    assert (kept.free_name(), kept.names, kept.views) == ("plan_2", ("plan_1",), {"plan_1": shown})
    better = view()
    for one in (better, view(2)):  # the second is of another state
        kept.improve(one)
    assert kept.views["plan_1"] is better


@pytest.mark.parametrize("name", ["", "..", "a/b", ".hidden", "a b", "x" * 61, "<b>"])
def test_a_name_that_no_folder_should_have_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="cannot name a plan"):
        KeptPlans(tmp_path, CASE).keep(name, view())
    assert list(tmp_path.iterdir()) == []


def test_an_existing_plan_is_not_overwritten_and_a_full_disk_is_reported(tmp_path: Path) -> None:
    kept = KeptPlans(tmp_path, CASE)
    kept.keep("mine", view())
    with pytest.raises(InputError, match="'mine' exists already"):
        kept.keep("mine", view())
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="nothing was kept"):
        KeptPlans(tmp_path / "file", CASE).keep("mine", view())


def test_a_page_that_is_killed_while_it_writes_leaves_no_plan(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("warp_trunk.bone_motion.plan.plan_file.write_case", killed)  # the rest is written before
        with pytest.raises(KeyboardInterrupt):
            KeptPlans(tmp_path, CASE).keep("mine", view())
    assert [path.name for path in tmp_path.iterdir()] == [".mine.partial"]
    again = KeptPlans(tmp_path, CASE)
    assert again.names == ()
    assert {path.name for path in again.keep("mine", view()).iterdir()} == FILES


def test_plans_of_before_are_found_and_no_others(tmp_path: Path) -> None:
    assert KeptPlans(tmp_path / "none", CASE).names == ()
    KeptPlans(tmp_path, CASE).keep("mine", view())
    moved = replace(CASE.landmarks_before, points=CASE.landmarks_before.points + 1.0)
    KeptPlans(tmp_path, replace(CASE, landmarks_before=moved)).keep("hers", view())
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "plan.toml").write_text("no plan")
    header = (tmp_path / "mine" / "case.toml").rename(tmp_path / "case.toml")
    assert KeptPlans(tmp_path, CASE).names == ()  # without it a folder is not whole
    header.rename(tmp_path / "mine" / "case.toml")
    again = KeptPlans(tmp_path, CASE)
    assert (again.names, again.earlier, again.views) == (("mine",), {"mine": SURGERY.plan}, {})


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
