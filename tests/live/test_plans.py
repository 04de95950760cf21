"""Sliders make plans and motions; kept plans are cases as `plan` writes them; the words of the page."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from support.small_case import part_case
from support.small_trunk import APEX, curved_case
from warp_trunk.bone_motion.plan import CurvePlan, Plan, PlannedSurgery, Planner, plan_surgery, read_plan
from warp_trunk.bone_motion.plan.surgery import surgery_record
from warp_trunk.case import read_case
from warp_trunk.case.landmarks import Landmarks, read_landmarks
from warp_trunk.case.motions import Motion, Turn, rigid_motions
from warp_trunk.case.points import Points
from warp_trunk.errors import InputError
from warp_trunk.geometry.rigid import RigidMotion
from warp_trunk.live.loopback import LoopbackServer
from warp_trunk.live.number_table import _rotation
from warp_trunk.live.saved_plans import SavedPlans
from warp_trunk.live.session import PlanView
from warp_trunk.live.sliders import (
    KYPHOSIS,
    LIV,
    UIV,
    Controls,
    MotionSliders,
    Setting,
    SpineSliders,
    first_state,
    with_handles,
)
from warp_trunk.measures.quantities import Measured, MeasureTable
from warp_trunk.recording.viewer import free_port
from warp_trunk.run.patient import motions_of
from warp_trunk.spine import cobb_angles
from warp_trunk.spine.apical import axial_rotation
from warp_trunk.spine.spine import asis_axis, spine_of

FILES = {"bones", "case.toml", "landmarks_after.csv", "landmarks_before.csv", "plan.json", "plan.toml", "skin.ply"}
CASE = curved_case()
SURGERY = plan_surgery(CASE, Plan(uiv="T4", liv="T11", curves=(CurvePlan(apex=APEX, correction=0.5),)))


def view(number: int = 1) -> PlanView:
    return PlanView(number, {}, SURGERY, {}, CASE.skin.vertices)


def test_a_kept_plan_is_the_planned_case(tmp_path: Path) -> None:
    saved, shown = SavedPlans(tmp_path / "plans", CASE), view()
    folder = saved.keep(saved.free_name(), shown)
    assert folder == tmp_path / "plans" / "plan_1"
    assert {path.name for path in folder.iterdir()} == FILES
    assert isinstance(shown.surgery, PlannedSurgery)
    assert read_plan(folder / "plan.toml") == SURGERY.plan
    after = read_landmarks(folder / "landmarks_after.csv")
    np.testing.assert_array_equal(after.points, SURGERY.landmarks_after.points)
    assert ", plan plan_1" in (folder / "case.toml").read_text(encoding="utf-8")
    assert (saved.free_name(), saved.names, saved.views) == ("plan_2", ("plan_1",), {"plan_1": shown})
    better = view()
    for newer in (better, view(2)):  # the second is of another state
        saved.improve(newer)
    assert saved.views["plan_1"] is better


@pytest.mark.parametrize("name", ["", "..", "a/b", ".hidden", "a b", "x" * 61, "<b>"])
def test_a_name_that_no_folder_should_have_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="cannot name a plan"):
        SavedPlans(tmp_path, CASE).keep(name, view())
    assert list(tmp_path.iterdir()) == []


def test_an_existing_plan_is_not_overwritten_and_a_full_disk_is_reported(tmp_path: Path) -> None:
    saved = SavedPlans(tmp_path, CASE)
    saved.keep("x" * 60, view())
    saved.keep("mine", view())
    with pytest.raises(InputError, match="'mine' exists already"):
        saved.keep("mine", view())
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(InputError, match="nothing was kept"):
        SavedPlans(tmp_path / "file", CASE).keep("mine", view())


def test_a_page_that_is_killed_while_it_writes_leaves_no_plan(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("warp_trunk.bone_motion.plan.plan_file.write_case", killed)  # the rest is written before
        with pytest.raises(KeyboardInterrupt):
            SavedPlans(tmp_path, CASE).keep("mine", view())
    assert [path.name for path in tmp_path.iterdir()] == [".mine.partial"]
    again = SavedPlans(tmp_path, CASE)
    assert again.names == ()
    assert {path.name for path in again.keep("mine", view()).iterdir()} == FILES


def test_plans_of_before_are_found_and_no_others(tmp_path: Path) -> None:
    assert SavedPlans(tmp_path / "none", CASE).names == ()
    SavedPlans(tmp_path, CASE).keep("mine", view())
    moved = replace(CASE.landmarks_before, points=CASE.landmarks_before.points + 1.0)
    SavedPlans(tmp_path, replace(CASE, landmarks_before=moved)).keep("hers", view())
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "plan.toml").write_text("no plan", encoding="utf-8")
    header = (tmp_path / "mine" / "case.toml").rename(tmp_path / "case.toml")
    assert SavedPlans(tmp_path, CASE).names == ()  # without it a folder is not whole
    header.rename(tmp_path / "mine" / "case.toml")
    again = SavedPlans(tmp_path, CASE)
    assert (again.names, again.earlier, again.views) == (("mine",), {"mine": SURGERY.plan}, {})


def test_bars_have_the_scale_of_the_levels_that_decide() -> None:
    rows = [
        Measured(state, level, "bsr_deg", angle)
        for state in ("before", "plan")
        for level, angle in {"T1": 68.0, "T8": 10.0, "L3": -5.0}.items()
    ]
    levels, _, bars = _rotation(MeasureTable(rows), ("before", "plan"))
    assert levels == [("T1", "68 right"), ("T8", "10 right"), ("L3", "5.0 left")]
    wide = [width for _, _, width, _, _ in bars]
    assert wide == pytest.approx([wide[2]] * 4 + [wide[2] / 2.0] * 2)


REST = SpineSliders(CASE)
MAJOR = max(cobb_angles(CASE.landmarks_before), key=lambda curve: curve.angle)
CORRECTION, DEROTATION = Setting("correction", MAJOR.apex), Setting("derotation", MAJOR.apex)
TURN = Turn(degrees=5.0, axis=(0.0, 0.0, 2.0), point=(0.0, -45.0, 100.0))
MOTIONS = {"front": Motion(translation=(0.0, -4.0, 0.0), rotation=TURN), "left": Motion(follows={"front": 0.5})}


def test_sliders_at_rest_move_nothing() -> None:
    state = first_state(REST)
    assert (state[UIV], state[LIV]) == (MAJOR.upper, MAJOR.lower)
    surgery = REST.surgery(state)
    assert surgery.landmarks_after is surgery.landmarks_before


def test_a_slider_is_the_share_of_its_curve() -> None:
    surgery = REST.surgery({**first_state(REST), CORRECTION: 50, KYPHOSIS: 30})
    curve = next(curve for curve in surgery.curves if curve.before == MAJOR)
    assert curve.cobb_after == pytest.approx(MAJOR.angle / 2.0, abs=0.1)
    assert surgery_record(surgery)["spine"]["Kyphosis T5 to T12"][1] == pytest.approx(30.0, abs=0.1)
    assert surgery.plan.curves[0].derotation is None  # 0 % asks for nothing


def test_the_kyphosis_has_plausible_ends_that_hold_the_patients_own() -> None:
    least, most, _ = REST.controls[KYPHOSIS].span
    assert least <= REST.controls[KYPHOSIS].first <= most
    assert (least, most) == (min(10, REST.controls[KYPHOSIS].first), 50)
    asked = SpineSliders(CASE, Plan(uiv="T3", liv="L2", kyphosis_T5_T12=58.0)).controls[KYPHOSIS]
    assert asked.span[:2] == (least, 58)


def test_undo_returns_to_before_a_drag_however_it_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    now, asked = [0.0], list[Any]()
    # of this module alone: the server in its thread has a clock of its own
    monkeypatch.setattr("warp_trunk.live.sliders.time", SimpleNamespace(monotonic=lambda: now[0]))
    server = LoopbackServer(free_port(), "sliders")
    try:
        controls, start = Controls(server.gui, REST, asked.append), first_state(REST)
        handles = controls._handles
        assert {name for name, handle in handles.items() if handle.disabled} == REST.without_effect(start)
        assert controls._undo.disabled
        for seconds, value in ((10.0, 10), (10.1, 20), (11.2, 30), (11.3, 40)):  # the hand stops for a second
            now[0] = seconds
            handles[CORRECTION].value = value
        assert asked[-1][CORRECTION] == 40
        assert not controls._undo.disabled
        handles[KYPHOSIS].value = 31  # another slider: a step of its own
        for wanted in ({**start, CORRECTION: 40}, start):
            controls.undo()
            assert asked[-1] == wanted
            assert {name: handle.value for name, handle in handles.items()} == wanted
    finally:
        server.stop()


def test_a_curve_outside_the_fusion_is_not_planned_and_has_no_effect() -> None:
    state = {**first_state(REST), UIV: "L1", LIV: "L4", CORRECTION: 50}
    assert REST.plan(state).curves == ()
    assert {CORRECTION, DEROTATION} <= REST.without_effect(state)
    assert not {CORRECTION, DEROTATION} & REST.without_effect(first_state(REST))


def test_what_sliders_do_not_say_is_that_of_the_first_plan() -> None:
    first_plan = Plan(uiv="T3", liv="L2", balance="centre", sva_after=5.0, unfused="fixed")
    sliders = SpineSliders(CASE, first_plan)
    plan = sliders.plan({**first_state(sliders), CORRECTION: 10})
    assert plan == replace(first_plan, curves=plan.curves)
    assert [c for c in plan.curves if c.correction] == [CurvePlan(MAJOR.apex, correction=0.1)]


def test_sliders_begin_where_a_plan_is() -> None:
    before = CASE.landmarks_before
    turned = abs(axial_rotation(spine_of(before), asis_axis(before))[MAJOR.apex] or 0.0)
    curve = CurvePlan(apex=MAJOR.apex, cobb_after=MAJOR.angle * 0.35, rotation_after=turned * 0.6)
    state = first_state(SpineSliders(CASE, Plan(uiv="T3", liv="L2", curves=(curve,), kyphosis_T5_T12=31.4)))
    assert (state[CORRECTION], state[DEROTATION], state[KYPHOSIS]) == (65, 40, 31)
    beside = CurvePlan(apex=MAJOR.upper, correction=0.5)  # another level of the curve
    asked = first_state(SpineSliders(CASE, Plan(uiv="T3", liv="L2", curves=(beside,))))
    assert (asked[CORRECTION], asked[DEROTATION]) == (50, 0)
    assert asked[KYPHOSIS] == first_state(REST)[KYPHOSIS]


def test_sliders_stand_where_the_motions_of_the_case_are() -> None:
    shift = RigidMotion.exp(np.array([0.1, -0.2, 0.3, 4.0, 5.0, 6.0]))
    rows: tuple = tuple(map(tuple, shift.as_matrix().tolist()))
    case = part_case(**MOTIONS, right=Motion(transform=rows, large=True))
    sliders = MotionSliders(case)
    state = first_state(sliders)
    assert [state[Setting(label, "front")] for label in ("Pitch °", "Roll °", "Yaw °")] == pytest.approx(
        [0.0, 0.0, 5.0]
    )
    assert state[Setting("front", "left")] == 50.0
    assert sliders.motions(state)["right"].large
    of_case, of_sliders = rigid_motions(case.motions), rigid_motions(sliders.motions(state))
    for bone, motion in of_case.items():
        np.testing.assert_allclose(of_sliders[bone].as_matrix(), motion.as_matrix(), atol=1e-6)


def test_sliders_of_motions_at_zero_move_nothing_and_no_bone_passes_into_another() -> None:
    case = with_handles(part_case(**MOTIONS))
    sliders = MotionSliders(case)
    still = dict.fromkeys(first_state(sliders), 0.0)
    assert not any(motion.moves for motion in motions_of(sliders.surgery(still).planned_case(case)).values())
    with pytest.raises(InputError, match=r"'front' passes .* into 'core'"):
        sliders.surgery({**still, Setting("Back mm", "front"): 35.0})


def test_kept_motions_are_a_case_without_handles_and_with_its_points(tmp_path: Path) -> None:
    marks = Landmarks(("tip", "bone"), np.array([[0.0, -80.0, 100.0], [0.0, -63.0, 100.0]]))
    case = with_handles(replace(part_case(**MOTIONS), points=Points(marks, {"tip": "bone"})))
    sliders = MotionSliders(case)
    shown = PlanView(1, {}, sliders.surgery(first_state(sliders)), {}, case.skin.vertices)
    saved = read_case(SavedPlans(tmp_path, case).keep("mine", shown))
    assert (saved.name, saved.landmarks_before.names) == ("part, motions mine", ())
    assert saved.points.pairs == {"tip": "bone"}
    for bone, motion in rigid_motions(saved.motions).items():
        np.testing.assert_allclose(motion.as_matrix(), rigid_motions(MOTIONS)[bone].as_matrix(), atol=1e-6)


def test_levels_in_the_wrong_order_are_refused_in_the_words_of_the_page() -> None:
    state = {**first_state(REST), UIV: "T12", LIV: "T5"}
    with pytest.raises(
        InputError, match="the upper vertebra must lie above the lower one, but T12 is not above T5"
    ):
        REST.surgery(state)


@pytest.mark.parametrize(
    ("target", "words"),
    [
        ("curve {apex}: Cobb angle after 4 degrees", "Correction 90 % of the curve {ends} cannot be met"),
        ("curve {apex}: rotation after 1 degrees", "Derotation "),
        ("kyphosis_T5_T12 50 degrees", "kyphosis T5-T12 of 50 degrees cannot be met"),
        ("sva_after 10 mm", "balance to the front of 10 mm cannot be met"),
    ],
)
def test_a_plan_that_cannot_be_met_is_refused_in_the_words_of_the_page(
    target: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (
        f"plan: {target.format(apex=MAJOR.apex)} cannot be met with what else is asked and kept; the nearest is 10"
    )

    def refused(_: object, __: object) -> None:
        raise InputError(f"{text}; ask for that, or fuse other levels")

    monkeypatch.setattr(Planner, "plan", refused)
    with pytest.raises(InputError) as of_page:
        REST.surgery(first_state(REST))
    said = str(of_page.value)
    assert said.startswith(words.format(ends=f"{MAJOR.upper}-{MAJOR.lower}"))
    if "Cobb" in target:
        assert "the nearest is 75 %" in said  # 10 of 40 degrees are left
    assert not re.search(r"[a-z]_[a-zT]|plan: |Cobb angle after|rotation after", said)
